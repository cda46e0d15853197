"""The latent step on the dragon at 56,822 and at 454,576 tets.

Equal r, k and points: the finer mesh is the coarser one refined, and its cubature points are one of the eight children
of each of the coarser's, so that both step the same model. The solids are those of cubature_models.py (`--runs`,
`--made`). Both are timed in turns, in one process on one thread, and the least time of each step counts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ldsim.cubature.choose import PoseSplit, choose_on_mesh, split_poses
from ldsim.cubature.options import FitOptions
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.jit import one_thread
from ldsim.pipeline.comparison import run_reduced
from reproduction.bench.cubature_models import Model, model
from reproduction.harness import called, parser, row, show, write_results
from reproduction.reduced_runs import reference

NAME = "step_sizes"
MOTION = "dragon"
FIT = FitOptions(tolerance=1e-3, max_points=35)
TRIES = 8


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("--runs", type=Path, default=Path("runs"), help="finished runs of the pipeline")
    arguments.add_argument("--made", type=Path, default=Path("runs/cubature"), help="what is made and kept")
    given = arguments.parse_args()
    with (
        one_thread(),
        model("dragon_56822", given.runs, given.made) as coarse,
        model("dragon", given.runs, given.made) as fine,
    ):
        medians = timed(coarse, fine)
        cells = {each.name: each.cells for each in (coarse, fine)}
    rows = [row(name, f"median latent step, {cells[name]:,} cells", value, "µs") for name, value in medians.items()]
    rows.append(row("dragon", "fine over coarse", medians["dragon"] / medians["dragon_56822"], "", "<= 1.2"))
    show(rows)
    write_results(NAME, called(NAME), rows)


def timed(coarse: Model, fine: Model) -> dict[str, float]:
    """Name → median step, µs, both with the points that were chosen on the coarse mesh."""
    poses = coarse.poses
    split = PoseSplit(*split_poses(len(poses.z), 150, 50, seed=0), recorded=len(poses.z))
    chosen = choose_on_mesh(poses, split, FIT).rules[-1]
    children = CubatureRule(8 * chosen.points, chosen.weights, 0.0)
    steppers = {
        each.name: ReducedStepper(each.poses.space.with_rule(rule))
        for each, rule in ((coarse, chosen), (fine, children))
    }
    coarse_reference = reference(coarse.run, MOTION)
    seconds: dict[str, list[np.ndarray]] = {name: [] for name in steppers}
    for _ in range(TRIES):
        for name, stepper in steppers.items():
            seconds[name].append(run_reduced(stepper, coarse_reference).seconds)
    return {name: 1e6 * float(np.nanmedian(np.nanmin(tries, axis=0))) for name, tries in seconds.items()}


if __name__ == "__main__":
    main()
