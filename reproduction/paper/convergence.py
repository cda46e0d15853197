"""Figure 9: how fast each space relaxes a bent solid to rest, quasi-statically."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullState, FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.jit import one_thread
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.scene import Scene
from ldsim.optimise.solution import Solution
from ldsim.report.svg import PALETTE, legend, log_scale, new_axes, to_svg
from ldsim.run import Run
from ldsim.space.encoder import nearest_latent
from ldsim.space.space import Space
from reproduction.harness import Harness
from reproduction.paper.experiment import Outcome, Relation
from reproduction.paper.scenes import cross
from reproduction.reduced_runs import latent, training_coordinates

Array = NDArray[np.float64]
Solve = Callable[[int], Solution]

# So long a time step that inertia is nothing: a quasi-static solve.
FOREVER = 1e8
TOLERANCE = 1e-8
MOST = 2000
SHOWN = (1, 2, 3, 5, 8, 12, 18, 25, 35, 50, 70, 100, 140, 200, 300)


def _full(scene: Scene, u: Array) -> Solve:
    def solve(most: int) -> Solution:
        # the rest pose's Hessian throughout, as in the paper
        options = FullOptions(tolerance=TOLERANCE, factor_cost=10**9, max_iterations=most)
        return FullStepper(scene, options).step(FullState(u, u, np.zeros_like(u)), Loads())[1]

    return solve


def _reduced(space: Space, z: Array) -> Solve:
    q = space.decoder(z)

    def solve(most: int) -> Solution:
        options = ReducedOptions(tolerance=TOLERANCE, max_iterations=most, method="lbfgs", current=False, inertia=False)
        return ReducedStepper(space, options).step(ReducedState.moving(z, z, q, q), Loads())[1]

    return solve


def _solves(run: Run) -> dict[str, Solve]:
    """A solve in each space from the pose of the training motion that is farthest from rest."""
    scene = replace(run.scene, gravity=np.zeros(3), time_step=FOREVER)
    q, model = training_coordinates(run), run.model
    farthest = int(np.linalg.norm(q, axis=1).argmax())
    z = nearest_latent(model.decoder, q[farthest], model.encoder(q[farthest : farthest + 1])[0])
    return {
        "latent": _reduced(replace(latent(run), scene=scene), z),
        "linear": _reduced(Space.linear(scene, run.basis, model.kp), q[farthest, : model.kp]),
        "full": _full(scene, run.basis.displacement(q[farthest])),
    }


def convergence(bench: Harness) -> Outcome:
    """Iterations, evaluations and final potential of each space, and the potential on the way."""
    with Run.open(bench.made(cross(bench.quick), "train")) as run, one_thread():
        solves = _solves(run)
        dimensions = {"latent": run.model.decoder.r, "linear": run.model.kp, "full": 3 * len(run.scene.free)}
        ends = {space: solve(MOST) for space, solve in solves.items()}
        curves = {
            space: [(most, solve(most).value) for most in SHOWN if most < ends[space].iterations]
            + [(ends[space].iterations, ends[space].value)]
            for space, solve in solves.items()
        }
    figure, ax = new_axes("iterations", "potential, J", height=3.2)
    for space, curve in curves.items():
        iterations, values = np.array(curve).T
        shown = values > 0
        ax.plot(iterations[shown], values[shown], color=PALETTE[space], marker=".", label=space)
    log_scale(ax, "y")
    legend(ax)
    numbers = {
        space: {
            "dimension": dimensions[space],
            "iterations": end.iterations,
            "evaluations": end.evaluations,
            "potential_j": end.value,
            "gradient_norm_n": end.gradient_norm,
            "reason": end.reason.words,
        }
        for space, end in ends.items()
    }
    label = "Potential against iterations of L-BFGS in the latent, the linear and the full space, relaxing to rest"
    return Outcome(to_svg(figure, label), {"spaces": numbers, "curves": curves}, convergence_relations(ends))


def convergence_relations(ends: dict[str, Solution]) -> tuple[Relation, ...]:
    """The relations of Figure 9 from the record of each space's solve."""
    latent, linear, full = (ends[space] for space in ("latent", "linear", "full"))
    return (
        Relation("iterations, latent over linear", latent.iterations / max(linear.iterations, 1), "< 1"),
        Relation("iterations, linear over full", linear.iterations / max(full.iterations, 1), "< 1"),
        Relation("potential that the latent space ends with, J", abs(latent.value), "<= 1e-12"),
    )
