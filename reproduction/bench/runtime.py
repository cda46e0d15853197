"""What a step costs in C and in numba, of finished runs, and what a model takes to load.

Both step the same frames of every motion in the latent and the linear space at the usual tolerance, in one process and
one thread, in turns. A motion is stepped several times, and the least time of each of its steps counts, for other
tenants of a machine only add time. "C from Python" is what a caller in Python pays, the calls that move grabs and the
solves of a grab of a condensed model included; "C" is the one call of ldsim_step, ctypes included.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.jit import one_thread
from ldsim.mechanics.loads import Loads, MotionLoads
from ldsim.run import REDUCED, Run
from ldsim.runtime.library import Library, NativeModel, NativeSolid, build
from ldsim.runtime.model_file import model_bytes
from ldsim.space.space import Space
from reproduction.bench.follower import Follower
from reproduction.harness import Row, called, parser, row, show, write_results

NAME = "runtime"
REPEATS = 7


def timed(step: Callable[[Loads], object], acting: list[Loads]) -> Array:
    """Seconds of each step."""
    seconds = np.empty(len(acting))
    for i, loads in enumerate(acting):
        started = time.perf_counter()
        step(loads)
        seconds[i] = time.perf_counter() - started
    return seconds


def timed_alone(follower: Follower, acting: list[Loads]) -> Array:
    """Seconds of each call of ldsim_step."""
    seconds = np.empty(len(acting))
    for i, loads in enumerate(acting):
        follower.take(loads)
        started = time.perf_counter()
        follower.solid.step()
        seconds[i] = time.perf_counter() - started
    return seconds


def numba(space: Space) -> Callable[[Loads], object]:
    """Steps by the compiled Python, from rest."""
    stepper = ReducedStepper(space)
    state = stepper.rest()

    def step(acting: Loads) -> None:
        nonlocal state
        state, _ = stepper.step(state, acting)

    return step


def measure(run: Run, name: str, library: Library) -> list[Row]:
    """The rows of one space."""
    space, rows = run.space(name), []
    data = model_bytes(space)
    started = time.perf_counter()
    model = NativeModel(library, data)
    rows.append(row(run.experiment, f"{name}: load", 1e3 * (time.perf_counter() - started), "ms", "<= 20"))
    rows.append(row(run.experiment, f"{name}: model", len(data) / 1e6, "MB"))
    for motion in run.motions:
        recorded = run.recorded(motion)
        loads = MotionLoads(recorded.motion, run.scene, dict(recorded.held))
        acting = [loads.at(frame) for frame in range(recorded.motion.frames)]
        seconds = {side: np.full(len(acting), np.inf) for side in ("numba", "C from Python", "C")}
        for _ in range(REPEATS):
            found = timed(numba(space), acting), timed(Follower(NativeSolid(model), space).step, acting)
            for side, each in zip(
                seconds, (*found, timed_alone(Follower(NativeSolid(model), space), acting)), strict=True
            ):
                seconds[side] = np.fmin(seconds[side], each)
        for side, least in seconds.items():
            for share in (50, 95, 99):
                what = f"{name}, {motion}: step in {side}, {share} %"
                rows.append(row(run.experiment, what, 1e6 * float(np.percentile(least, share)), "µs"))
    return rows


def main() -> None:
    options = parser(NAME, __doc__)
    options.add_argument("runs", nargs="+", type=Path, help="folders of finished runs")
    rows: list[Row] = []
    runs = options.parse_args().runs
    with one_thread(), tempfile.TemporaryDirectory() as folder:
        library = Library(build(Path(folder), ("-march=native",)))
        for path in runs:
            with Run.open(path) as run:
                for name in REDUCED:
                    rows += measure(run, name, library)
    show(rows)
    write_results(NAME, called(NAME), rows)


if __name__ == "__main__":
    main()
