"""Error against step time of finished runs, the linear space swept: python benchmarks/step.py runs/x [runs_2/x …]

Every space, linear or latent, has a cubature of its own on the mesh and virtual points of several sizes, fitted to the
same poses, and the fastest of its minimisers, with the stop rule as the paper prints it and as the authors' code does.
What is fitted is kept in `step` beside the runs. More runs of the same scene add their latent spaces: other r, k and
widths. All are judged with the loosest stop on every motion of the first run, whole and restarted every 0.25 s, and
timed in one process, one thread, in turns: a motion is stepped several times, and the least time of each of its steps
counts, for other tenants of a machine only add time. The frontier of each motion goes to
docs/pictures/step_RUN_MOTION.svg. `--quick` takes four dimensions, `--linear 40` only this one (may be repeated).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from judging import errors
from numpy.typing import NDArray
from results_file import write_results
from step_frontier import Point, picture, ratios, rows
from step_spaces import latent_spaces, linear_spaces
from tqdm import tqdm

from ldsim.artefacts.records import read_basis, read_model, read_scene
from ldsim.artefacts.snapshots import Recorded, Snapshots
from ldsim.dynamics.reduced.minimiser import Method
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.jit import one_thread
from ldsim.mechanics.scene import Scene
from ldsim.pipeline.comparison import ReducedSpace, fastest, run_reduced
from ldsim.space.pca import inner_product

DIMENSIONS = (20, 25, 30, 35, 40, 50, 60)
QUICK = (20, 30, 40, 50)
# ‖∇E‖ ≤ stop · max(‖z‖, 1), N: 10⁻⁸ of the potential as the paper prints it; the same, and the 10⁻⁷ of some of its
# models, of what the authors' code minimises: h² times the potential with h = 5 ms.
STOPS = (1e-8, 4e-4, 4e-3)
REPEATS = 5
PICTURES = Path(__file__).parent.parent / "docs" / "pictures"


@dataclass(eq=False)
class Timed:
    """One space with one stop rule: its stepper, and the least time of each step of each motion so far, seconds."""

    space: ReducedSpace
    stop: float
    minimiser: str
    stepper: ReducedStepper
    seconds: dict[str, NDArray[np.float64]]
    evaluations: dict[str, float]

    @classmethod
    def of(cls, scene: Scene, space: ReducedSpace, stop: float, first: Recorded) -> Timed:
        """With the minimiser that is fastest on the first motion."""

        def make(method: Method, current: bool) -> ReducedStepper:
            return space.stepper(scene, stop, 200, method, current)

        return cls(space, stop, *fastest(make, scene, first.motion, first.held), {}, {})

    def run(self, scene: Scene, recorded: Recorded) -> None:
        """Step a motion once more."""
        name = recorded.motion.name
        run = run_reduced(self.stepper, scene, recorded.motion, recorded.held, range(recorded.motion.frames))
        before = self.seconds.get(name, run.seconds)
        self.seconds[name] = np.fmin(before, run.seconds)
        self.evaluations[name] = float(run.evaluations.mean())


def point(timed: Timed, motion: str, online: float, windowed: float) -> Point:
    seconds, space = timed.seconds[motion], timed.space
    return Point(
        space.name,
        motion,
        space.decoder.r,
        space.decoder.k,
        len(space.cubature.points),
        timed.stop,
        timed.minimiser,
        1e3 * float(np.nanmedian(seconds)),
        1e3 * float(np.nanpercentile(seconds, 99)),
        timed.evaluations[motion],
        online,
        windowed,
    )


def main(folders: list[Path], dimensions: Sequence[int], kept: Path) -> None:
    folder = folders[0]
    scene, _ = read_scene(folder / "scene.h5")
    basis = read_basis(folder / "basis.h5")[0].basis.U.shape[1]
    kp = read_model(folder / "model.h5")[0].kp
    metric = inner_product(scene.mass, "mass")
    timed: list[Timed] = []
    error: dict[tuple[int, str], tuple[float, float]] = {}
    with Snapshots(folder / "snapshots.h5") as snapshots, one_thread(), tqdm(unit="set", disable=None) as bar:
        motions = {name: snapshots.recorded(name) for name in snapshots.names}
        swept = sorted({*(dimensions or (*DIMENSIONS, kp))} & set(range(basis + 1)))
        spaces = [latent_spaces(each) for each in folders] + [linear_spaces(folder, swept, kept)]
        for space in (space for some in spaces for space in some):
            bar.set_description(f"{space.name} {space.decoder.r}, {len(space.cubature.points)} points")
            timed += [Timed.of(scene, space, stop, motions[snapshots.names[0]]) for stop in STOPS]
            for name, recorded in motions.items():
                error[id(space), name] = errors(
                    scene, space, timed[-1].stepper, recorded, snapshots.reader(name), metric
                )
            bar.update()
        for each, recorded in tqdm(
            list(product(REPEATS * timed, motions.values())), "timing", unit="run", disable=None
        ):
            each.run(scene, recorded)
    table = [point(each, name, *error[id(each.space), name]) for each in timed for name in motions]
    print("| " + " | ".join(Point._fields) + " |\n" + "|---" * len(Point._fields) + "|")
    for entry in table:
        print("| " + " | ".join(f"{v:.3g}" if isinstance(v, float) else str(v) for v in entry) + " |")
    model = folder.name
    found = ratios(model, table, kp)
    for row in found:
        print(row["quantity"], row["value"], "goal", row["goal"])
    command = " ".join(["python benchmarks/step.py", *sys.argv[1:]])
    write_results(f"step_{model}", command, found + rows(model, table))
    for motion in dict.fromkeys(point.motion for point in table):
        drawn = picture(model, motion, table)
        (PICTURES / f"step_{model}_{motion}.svg").write_text(drawn + "\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Error against step time, latent and linear.")
    parser.add_argument("runs", nargs="+", type=Path, help="folders of finished runs, the scene of the first one")
    parser.add_argument("--linear", type=int, action="append", help="only this linear dimension")
    parser.add_argument("--quick", action="store_true", help="four linear dimensions")
    given = parser.parse_args()
    main(given.runs, given.linear or (QUICK if given.quick else ()), given.runs[0].parent / "step")
