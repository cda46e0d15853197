"""What a condensed latent space is worth beside linear ones and an autoencoder, on every motion of finished runs.

The runs are made with `train.kind: condensed`, or without, for an autoencoder to compare with. The latent space is
stepped as `ldsim simulate` steps it; the linear spaces have every element integrated, which is the best error that they
can have and says nothing of their time. A row tells how many linear dimensions a condensed coordinate is worth on a
motion; where no dimension swept is as good, that it is worth more than the largest. Beside them stand two floors:
linear elasticity in the full space, which tells how nonlinear a motion is, and the condensed space of linear
elasticity, which needs no samples. Then loads that no motion had, from rest, beside the full space: gravity of other
directions, and two grabs at once. Results go to reproduction/results/condensed.json, beside those of other solids.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.export.arrays import default_pull
from ldsim.jit import one_thread
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.materials import material_number
from ldsim.run import Run
from ldsim.space.relaxation import Relaxation
from ldsim.space.space import Space
from reproduction.harness import PIPELINE, Row, add_results, called, parser, row, show
from reproduction.reduced_runs import WINDOW, played, reference
from reproduction.rivals.condensed_linear import condensed_linear
from reproduction.rivals.every_element import EveryElement

NAME = "condensed"
DIMENSIONS = (16, 20, 40, 60, 80, 100)
# Largest online error of each solid's motions, as the project asks for it; of its recording, where that is another.
GOALS = {"x": 0.03, "elephant": 0.02, "armadillo": 0.08, "dragon": 0.05, "beam": 0.02}
ON_RECORDING = {("elephant", "elephant"): 0.05, ("elephant", "local_effect"): 0.15}
LINEAR_WORTH = ">= 5"
# Of the reduced steps, N: 10⁻⁷ of h² times the potential, the loosest of the authors' code.
STOP = ReducedOptions(tolerance=4e-3)
# Of the loads that no motion had: how many frames, and in how many a pull reaches its target.
FRAMES, RAMP = 150, 40


def asked(solid: str, motions: Sequence[str]) -> str | None:
    """The goal of some motions of a solid together, where they have one and the same."""
    goals = {ON_RECORDING.get((solid, motion), GOALS.get(solid)) for motion in motions}
    goal = goals.pop() if len(goals) == 1 else None
    return None if goal is None else f"<= {goal:g}"


def unseen_loads(run: Run) -> dict[str, Callable[[int], Loads]]:
    """Name → what acts in a frame."""
    X, pinned = run.scene.mesh.vertices, run.scene.pinned
    g, size = float(np.linalg.norm(run.scene.gravity)) or 9.8, run.scene.mesh.diagonal
    # the free vertices farthest to either side; each is pulled a seventh of the solid's size outwards and across
    free = np.flatnonzero(~pinned)
    ends = [free[side(X[free, 0] + 0.5 * X[free, 1] * sign)] for side, sign in ((np.argmax, 1), (np.argmin, -1))]
    held = [np.flatnonzero((np.linalg.norm(X - X[v], axis=1) < 0.07 * size) & ~pinned) for v in ends]
    pulls = 0.15 * size * np.array([[1.0, 0.6, 0.4], [-0.8, 0.4, -1.0]])
    _, stiffness = default_pull(run)

    def grabs(frame: int) -> Loads:
        share = min(frame / RAMP, 1.0)
        centres = [X[vertices].mean(axis=0) for vertices in held]
        targets = [centre + share * pull for centre, pull in zip(centres, pulls, strict=True)]
        return Loads(tuple(Grab(v, target, stiffness) for v, target in zip(held, targets, strict=True)))

    return {
        "gravity sideways": lambda frame: Loads(gravity=np.array([g, 0.0, 0.0])),
        "gravity upside down": lambda frame: Loads(gravity=np.array([0.0, g, 0.0])),
        "two grabs": grabs,
    }


def under_unseen_loads(run: Run, swept: tuple[int, ...]) -> list[Row]:
    """Relative errors from rest, mean vertex distance over all frames by mean displacement."""
    spaces = [Space.linear(run.scene, run.basis, k) for k in swept if k <= run.basis.k]
    steppers = {f"linear {space.r}": ReducedStepper(space) for space in spaces}
    steppers[f"stepped {run.model.decoder.r}"] = ReducedStepper(run.space("latent"), STOP)
    full, rows = FullStepper(run.scene), []
    for name, acting in unseen_loads(run).items():
        states, u, moved = {key: stepper.rest() for key, stepper in steppers.items()}, full.rest(), 0.0
        distance = dict.fromkeys(steppers, 0.0)
        for frame in range(FRAMES):
            u, _ = full.step(u, acting(frame))
            moved += np.linalg.norm(u.u, axis=1).mean()
            for key, stepper in steppers.items():
                states[key], _ = stepper.step(states[key], acting(frame))
                distance[key] += np.linalg.norm(stepper.displacement(states[key]) - u.u, axis=1).mean()
        for key, total in distance.items():
            goal = "<= 0.1" if key.startswith("stepped") else None
            rows.append(row(run.experiment, f"online error, {name}, {key}", total / moved, "", goal))
    return rows


def linear_elasticity(run: Run, motion: str) -> float:
    """Relative error of a motion, where the full space is of linear elasticity."""
    scene, full = run.scene, reference(run, motion)
    stepper = FullStepper(replace(scene, material=np.full_like(scene.material, material_number("linear"))))
    off = moved = 0.0
    for frame in simulate(stepper, full.motion, held=full.held):
        u = full.displacement(scene, frame.number)
        off += np.linalg.norm(stepper.displacement(frame.state) - u, axis=1).mean()
        moved += np.linalg.norm(u, axis=1).mean()
    return off / moved


def floors(run: Run, motion: str, label: str) -> list[Row]:
    """What is reached without any nonlinearity."""
    r = run.model.decoder.r
    space = condensed_linear(Relaxation(run.scene, run.space("latent").reduced_basis.columns(r)))
    condensed = played(ReducedStepper(space, STOP), reference(run, motion)).relative_error
    return [
        row(run.experiment, f"floor, {label}, linear elasticity, full space", linear_elasticity(run, motion)),
        row(run.experiment, f"floor, {label}, condensed linear {r}", condensed),
    ]


def errors(rows: list[Row], motion: str, kind: str) -> dict[int, float]:
    """Online error by dimension, of the linear or the latent spaces."""
    start = f"online error, {motion}, {kind} "
    found = {int(r["quantity"].removeprefix(start)): r["value"] for r in rows if r["quantity"].startswith(start)}
    return {size: error for size, error in sorted(found.items()) if error is not None}


def worth(latent: float, linear: dict[int, float]) -> float | None:
    """The linear dimension with the same error, interpolated in its logarithm; None beyond what was swept."""
    if not linear or not np.isfinite(latent):
        return None
    k = np.array(sorted(linear))
    errors = np.log([linear[i] for i in k])
    if not errors.min() <= np.log(latent) <= errors.max():
        return None
    falling = np.minimum.accumulate(errors)[::-1]
    return float(np.interp(np.log(latent), falling, k[::-1]))


def measure(run: Run, solid: str, swept: tuple[int, ...]) -> list[Row]:
    """The rows of one finished run."""
    name, model, cells, notes = run.experiment, run.model, run.scene.mesh.n_cells, run.header("model").notes
    rows = [
        row(name, "r", model.decoder.r, "", "<= 16"),
        row(name, "cells", cells),
        row(name, "time of the train stage", float(notes["seconds"]), "s", "<= 600" if cells <= 30_000 else "<= 1800"),
        row(name, "peak memory of the train stage", float(notes["peak_memory_mb"]), "MB"),
    ]
    if model.potential is not None:
        chosen = run.cubature["latent"].virtual is not None
        rows.append(row(name, "median error of V_eff's force, poses kept back", model.potential.heldout_error))
        rows.append(row(name, "V_eff was judged better than points of the mesh", chosen))
    motions, stepper = list(run.played.names), ReducedStepper(run.space("latent"), STOP)
    for motion in motions:
        role, found = run.recorded(motion).role, played(stepper, reference(run, motion), WINDOW)
        label = f"{motion} ({role}), stepped {model.decoder.r}"
        goal = asked(solid, [motion]) if role != "train" else None
        rows.append(row(name, f"online error, {label}", found.relative_error, "", goal))
        rows.append(row(name, f"windowed error, {label}", found.windowed_error))
    for motion in motions:
        label = f"{motion} ({run.recorded(motion).role})"
        for k in (k for k in swept if k <= run.basis.k):
            space = Space.linear(run.scene, run.basis, k)
            online = played(EveryElement(space), reference(run, motion)).relative_error
            rows.append(row(name, f"online error, {label}, linear {k}", online))
        rows += floors(run, motion, label)
        linear = errors(rows, label, "linear")
        for r, error in errors(rows, label, "stepped").items():
            equal = worth(error, linear)
            if equal is not None:
                rows.append(row(name, f"kp/r, {label}", equal / r, "", LINEAR_WORTH))
            elif linear and np.isfinite(error) and error < min(linear.values()):
                rows.append(row(name, f"kp/r, {label}, more than", max(linear) / r, "", LINEAR_WORTH))
    rows += under_unseen_loads(run, swept[:3])
    show(rows, name)
    return rows


def arguments() -> argparse.ArgumentParser:
    found = parser(NAME, __doc__)
    found.add_argument("runs", nargs="+", type=Path, help="folders of finished runs")
    found.add_argument("--linear", type=int, action="append", help="only this linear dimension")
    return found


def main() -> None:
    given = arguments().parse_args()
    swept = tuple(given.linear or DIMENSIONS)
    with one_thread():
        for folder in given.runs:
            with Run.open(folder) as run:
                solid = run.experiment.removesuffix("_condensed")
                add_results(NAME, called(NAME), measure(run, solid, swept), PIPELINE)


if __name__ == "__main__":
    main()
