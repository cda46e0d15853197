"""Section 6.2's solvers: Newton's method beside L-BFGS, and L-BFGS with and without its preconditioner."""

from __future__ import annotations

import numpy as np

from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.trajectory import Trajectory
from ldsim.jit import one_thread
from ldsim.report.svg import PALETTE, new_axes, to_svg
from ldsim.run import Run
from ldsim.space.space import Space
from reproduction.harness import Harness
from reproduction.paper.experiment import Outcome, Relation
from reproduction.paper.minimisers import INERTIA, NEWTON, PAPER
from reproduction.paper.scenes import armadillo
from reproduction.reduced_runs import a_step, played, reference

TRIES, FRAMES = 3, 300


class Unpreconditioned(ReducedStepper):
    """L-BFGS from a multiple of the identity, one for the whole run: the mean curvature of the coordinates at rest.

    The springs of grabs are in it, as they are in every preconditioner here.
    """

    def __init__(self, space: Space, options: ReducedOptions) -> None:
        super().__init__(space, options.replace(every_step=False))
        J = space.decoder.jacobian(np.zeros(space.r))
        self._curvature = float(np.trace(J.T @ (self.mass / self.scene.time_step**2 + self._stiffness) @ J)) / space.r
        self._renewal_cost = 10**9
        self._minimisation = self._minimisation._replace(renewal=10**9)

    def rest(self) -> ReducedState:
        state = super().rest()
        state.H[:], state.usable = np.eye(self.space.r) / self._curvature, True
        return state


def solvers(bench: Harness) -> Outcome:
    """Iterations and time of a step of each solver in the linear and the latent space, in the first frames of the
    armadillo's training motion."""
    with Run.open(bench.made(armadillo(bench.quick), "cubature")) as run, one_thread():
        spaces = {name: run.space(name) for name in ("linear", "latent")}
        steppers: dict[str, dict[str, ReducedStepper]] = {
            "L-BFGS, Eq. 15": {name: ReducedStepper(space, PAPER) for name, space in spaces.items()},
            "L-BFGS, identity": {name: Unpreconditioned(space, PAPER) for name, space in spaces.items()},
            "L-BFGS, inertia too": {name: ReducedStepper(space, INERTIA) for name, space in spaces.items()},
            "Newton": {name: ReducedStepper(space, NEWTON) for name, space in spaces.items()},
        }
        first = reference(run, run.snapshots.with_role("train")[0], FRAMES)
        found = {
            solver: {name: _median([played(stepper, first) for _ in range(TRIES)]) for name, stepper in both.items()}
            for solver, both in steppers.items()
        }
    figure, ax = new_axes("", "median step, ms", height=3.0)
    places = np.arange(len(found))
    for shift, name in ((-0.2, "linear"), (0.2, "latent")):
        values = [found[solver][name]["step_ms"] for solver in found]
        ax.bar(places + shift, values, 0.38, color=PALETTE[name], label=f"{name}, {spaces[name].r}")
    ax.set_xticks(places, [solver.replace(", ", ",\n") for solver in found])
    ax.legend(frameon=False, fontsize=9)
    step = {solver: {name: each["step_ms"] for name, each in both.items()} for solver, both in found.items()}
    plain = min(step["L-BFGS, Eq. 15"]["linear"], step["L-BFGS, identity"]["linear"])
    relations = (
        Relation(
            "iterations a step in the linear space, Newton over L-BFGS",
            found["Newton"]["linear"]["iterations"] / found["L-BFGS, Eq. 15"]["linear"]["iterations"],
            "< 1",
        ),
        Relation(
            "time of a step in the linear space, Newton over L-BFGS",
            step["Newton"]["linear"] / step["L-BFGS, Eq. 15"]["linear"],
            "> 1",
            paper=1.3,
        ),
        Relation(
            "time of a step in the linear space, without the preconditioner over with it",
            step["L-BFGS, identity"]["linear"] / step["L-BFGS, Eq. 15"]["linear"],
            "< 1",
            paper=9.60 / 10.5,
        ),
        Relation(
            "linear step over latent step, the better L-BFGS each",
            plain / min(step["L-BFGS, Eq. 15"]["latent"], step["L-BFGS, identity"]["latent"]),
            ">= 1.52",
            paper=1.52,
        ),
    )
    label = "Median time of a step by solver, in the linear and the latent space"
    return Outcome(to_svg(figure, label), {"solvers": found}, relations)


def _median(tries: list[Trajectory]) -> dict[str, float]:
    """Of several runs of one motion; the time of each step is the least of them."""
    least = np.nanmin([each.seconds for each in tries], axis=0)
    error = tries[0].relative_error
    return {
        "iterations": a_step(tries[0].iterations, tries[0]),
        "evaluations": a_step(tries[0].evaluations, tries[0]),
        "step_ms": 1e3 * float(np.nanmedian(least)),
        "online_error": float("nan") if error is None else error,
    }
