"""The latent step on the dragon at 56,822 and at 454,576 tets: python benchmarks/step_sizes.py

Equal r, k and points: the finer mesh is the coarser one refined, and its cubature points are one of the eight children
of each of the coarser's, so that both step the same model. The solids are those of cubature_models.py (`--runs`,
`--made`). Both are timed in turns, in one process on one thread, and the least time of each step counts.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from cubature_models import model
from results_file import row, write_results

from ldsim.cubature.goal import Goal
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.selection import Recipe, select, split_poses
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.jit import one_thread
from ldsim.pipeline.comparison import run_reduced

MOTION = "dragon"
POINTS = 35
TRIES = 8


def main() -> None:
    parser = argparse.ArgumentParser(description="The latent step on the dragon, coarse and fine.")
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="finished runs of the pipeline")
    parser.add_argument("--made", type=Path, default=Path("runs/cubature"), help="what is made and kept")
    given = parser.parse_args()
    steppers, seconds, cells = {}, {}, {}
    with one_thread(), model("dragon_56822", given.runs, given.made) as coarse:
        fitted, kept_back = split_poses(len(coarse.space.z), 150, 50, seed=0)
        chosen = select(coarse.space, fitted, kept_back, Recipe(Goal(1e-3, POINTS))).fit.ladder[-1]
        with model("dragon", given.runs, given.made) as fine:
            for name, space, points in (
                ("dragon_56822", coarse.space, chosen.points),
                ("dragon", fine.space, 8 * chosen.points),
            ):
                steppers[name] = ReducedStepper(
                    space.scene, space.U, space.decoder, CubatureRule(points, chosen.weights, 0.0)
                )
                seconds[name], cells[name] = [], space.scene.mesh.n_cells
            recorded = coarse.snapshots.recorded(MOTION)
            for _ in range(TRIES):
                for name, stepper in steppers.items():
                    frames = range(recorded.motion.frames)
                    done = run_reduced(stepper, coarse.space.scene, recorded.motion, recorded.held, frames)
                    seconds[name].append(done.seconds)
    medians = {name: 1e6 * float(np.nanmedian(np.nanmin(tries, axis=0))) for name, tries in seconds.items()}
    rows = [row(name, f"median latent step, {cells[name]:,} cells", value, "µs") for name, value in medians.items()]
    rows.append(row("dragon", "fine over coarse", medians["dragon"] / medians["dragon_56822"], "", "<= 1.2"))
    for r in rows:
        print(f"| {r['model']} | {r['quantity']} | {r['value']:.4g} | {r['unit']} |")
    write_results("step_sizes", "python benchmarks/step_sizes.py", rows)


if __name__ == "__main__":
    main()
