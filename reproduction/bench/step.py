"""Error against step time of finished runs, the linear space swept.

Every space, linear or latent, has a cubature of its own on the mesh and virtual points of several sizes, fitted to the
same poses, and the fastest of its minimisers, with the stop rule as the paper prints it and as the authors' code does.
What is fitted is kept in `step` beside the runs. More runs of the same scene add their latent spaces: other r, k and
widths. All are judged with the loosest stop on every motion of the first run, whole and restarted every 0.25 s, and
timed in one process, one thread, in turns: a motion is stepped several times, and the least time of each of its steps
counts, for other tenants of a machine only add time. `--quick` takes four
dimensions, `--linear 40` only this one (may be repeated).
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.trajectory import Trajectory
from ldsim.jit import one_thread
from ldsim.pipeline.comparison import Reference, fastest, run_reduced
from ldsim.run import Run
from ldsim.space.space import Space
from reproduction.bench.step_frontier import Point, ratios, rows
from reproduction.bench.step_spaces import latent_spaces, linear_spaces
from reproduction.harness import called, parser, show, write_results
from reproduction.reduced_runs import WINDOW, played, reference

NAME = "step"
DIMENSIONS = (20, 25, 30, 35, 40, 50, 60)
QUICK = (20, 30, 40, 50)
# ‖∇E‖ ≤ stop · max(‖z‖, 1), N: 10⁻⁸ of the potential as the paper prints it; the same, and the 10⁻⁷ of some of its
# models, of what the authors' code minimises: h² times the potential with h = 5 ms.
STOPS = (1e-8, 4e-4, 4e-3)
REPEATS = 5


@dataclass(eq=False)
class Timed:
    """One space with one stop rule: its stepper, and the least time of each step of each motion so far, seconds."""

    space: Space
    stop: float
    minimiser: str
    stepper: ReducedStepper
    seconds: dict[str, NDArray[np.float64]]
    evaluations: dict[str, float]

    @classmethod
    def of(cls, space: Space, stop: float, first: Reference) -> Timed:
        """With the minimiser that is fastest on the first motion."""
        return cls(space, stop, *fastest(space, first, ReducedOptions(tolerance=stop)), {}, {})

    def run(self, full: Reference) -> None:
        """Step a motion once more."""
        name, run = full.motion.name, run_reduced(self.stepper, full)
        self.seconds[name] = np.fmin(self.seconds.get(name, run.seconds), run.seconds)
        self.evaluations[name] = float(run.evaluations.mean())


def point(timed: Timed, motion: str, judged: Trajectory) -> Point:
    seconds, space = timed.seconds[motion], timed.space
    assert judged.relative_error is not None and judged.windowed_error is not None
    return Point(
        space.name,
        motion,
        space.r,
        space.decoder.k,
        len(space.rule.points),
        timed.stop,
        timed.minimiser,
        1e3 * float(np.nanmedian(seconds)),
        1e3 * float(np.nanpercentile(seconds, 99)),
        timed.evaluations[motion],
        judged.relative_error,
        judged.windowed_error,
    )


def measure(runs: list[Run], dimensions: list[int], kept: Path) -> list[Point]:
    """Every space with every stop rule on every motion of the first run."""
    run = runs[0]
    motions = {name: reference(run, name) for name in run.played.names}
    first = motions[run.played.names[0]]
    timed: list[Timed] = []
    judged: dict[tuple[int, str], Trajectory] = {}
    with tqdm(unit="rule", disable=None) as bar:
        for space in (*(s for each in runs for s in latent_spaces(each)), *linear_spaces(run, dimensions, kept)):
            bar.set_description(f"{space.name} {space.r}, {len(space.rule.points)} points")
            timed += [Timed.of(space, stop, first) for stop in STOPS]
            for name, full in motions.items():
                judged[id(space), name] = played(timed[-1].stepper, full, WINDOW)
            bar.update()
    for each, full in tqdm(list(product(REPEATS * timed, motions.values())), "timing", unit="run", disable=None):
        each.run(full)
    return [point(each, name, judged[id(each.space), name]) for each in timed for name in motions]


def write(model: str, table: list[Point], kp: int, quick: bool) -> None:
    """Print the table and the ratios, and write both."""
    print("| " + " | ".join(Point._fields) + " |\n" + "|---" * len(Point._fields) + "|")
    for entry in table:
        print("| " + " | ".join(f"{v:.3g}" if isinstance(v, float) else str(v) for v in entry) + " |")
    found = ratios(model, table, kp)
    show(found, "Ratios")
    suffix = "_quick" if quick else ""
    write_results(f"step_{model}{suffix}", called(NAME), found + rows(model, table))


def arguments() -> argparse.ArgumentParser:
    found = parser(NAME, __doc__)
    found.add_argument("runs", nargs="+", type=Path, help="folders of finished runs, the scene of the first one")
    found.add_argument("--linear", type=int, action="append", help="only this linear dimension")
    found.add_argument("--quick", action="store_true", help="four linear dimensions")
    return found


def main() -> None:
    given = arguments().parse_args()
    first = given.runs[0]
    with ExitStack() as stack, one_thread():
        runs = [stack.enter_context(Run.open(folder)) for folder in given.runs]
        kp = runs[0].model.kp
        wanted = given.linear or (QUICK if given.quick else (*DIMENSIONS, kp))
        swept = sorted(k for k in set(wanted) if k <= runs[0].basis.k)
        write(first.name, measure(runs, swept, first.parent / "step"), kp, given.quick)


if __name__ == "__main__":
    main()
