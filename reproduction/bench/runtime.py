"""What a step costs in C and in numba, of finished runs, and what a model takes to load.

Both step the same frames of every motion in the latent and the linear space at the usual tolerance, in one process and
one thread, in turns. A motion is stepped several times, and the least time of each of its steps counts, for other
tenants of a machine only add time; beside it stands how far the run's own simulation of the whole motion was off. The C
library also steps them at two other stops. "C from Python" is what a caller in Python pays, the calls that move grabs
and the solves of a grab of a condensed model included; "C" is the one call of ldsim_step, ctypes included. "Python's
own" is what a step of a solid that stands still takes from Python beyond one of many that are made by a single call of
the library; held: with a call that moves the grab.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.jit import one_thread
from ldsim.mechanics.loads import Loads, MotionLoads
from ldsim.mechanics.random_pulls import spread_points
from ldsim.run import REDUCED, Run
from ldsim.runtime.batch import BatchedSimulator
from ldsim.runtime.library import Library, NativeModel, NativeSolid, build
from ldsim.runtime.model_file import model_bytes
from ldsim.space.space import Space
from reproduction.bench.follower import Follower
from reproduction.harness import Row, called, parser, row, show, write_results
from tests.runtime import problems

NAME = "runtime"
REPEATS = 5
INSTANCES = 64
# Of each motion, for time.
FRAMES = 600
MANY = 100
# N.
STOPS = (1e-8, 4e-3)


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
    space, loaded = run.space(name), []
    if space.compliance is not None:
        space = replace(space, compliance=space.compliance.anchored())
    data = model_bytes(space)
    for _ in range(REPEATS):
        started = time.perf_counter()
        model = NativeModel(library, data)
        loaded.append(1e3 * (time.perf_counter() - started))
    rows = [row(run.experiment, f"{name}: load", min(loaded), "ms", "<= 20")]
    rows.append(row(run.experiment, f"{name}: model", len(data) / 1e6, "MB"))
    rows.append(row(run.experiment, f"{name}: grab", 1e3 * grab_seconds(run, model), "ms", "<= 1"))
    for motion in run.motions:
        acting = frames_of(run, motion)
        rows.append(row(run.experiment, f"{name}, {motion}: online error", error_of(run, name, motion), ""))
        rows += steps_of(run, motion, space, model, acting)
        for stop in STOPS:
            stopping = NativeModel(library, model_bytes(space, ReducedOptions(tolerance=stop)))
            seconds = np.min(
                [timed_alone(Follower(NativeSolid(stopping), space), acting) for _ in range(REPEATS)], axis=0
            )
            rows += shares(run, f"{name}, {motion}: step in C at {stop:g} N", seconds)
    for threads in (1, 2):
        rows.append(
            row(run.experiment, f"{name}: {INSTANCES} instances, {threads} threads", rate(run, model, threads), "1/s")
        )
    return rows


def grab_seconds(run: Run, model: NativeModel) -> float:
    """The median of taking hold of points spread over the surface, each the least of several times."""
    seconds = []
    for vertex in spread_points(run.scene, 20).tolist():
        point, tries = run.scene.mesh.vertices[vertex], []
        for _ in range(REPEATS):
            solid = NativeSolid(model)
            started = time.perf_counter()
            solid.grab(point, point)
            tries.append(time.perf_counter() - started)
        seconds.append(min(tries))
    return float(np.median(seconds))


def own_part(library: Library) -> list[Row]:
    """What Python itself takes of a step, free and held: of a model so small that it stays in the cache meanwhile."""
    space = problems.linear()
    rows, solid, point = [], NativeSolid(NativeModel(library, model_bytes(space))), space.scene.mesh.vertices[-1]
    grab = -1

    def step() -> None:
        if grab >= 0:
            solid.move(grab, point)
        solid.step()

    for what in ("free", "held"):
        solid.step_many(5000)
        one, many = np.empty(2000), np.empty(2000)
        for i in range(len(one)):  # in turns
            one[i], many[i] = seconds_of(step), seconds_of(lambda: solid.step_many(MANY)) / MANY
        own = 1e6 * float(np.median(one) - np.median(many))
        rows.append(row("a small beam", f"Python's own part of a step, {what}", own, "µs", "<= 2"))
        grab = solid.grab(point, point)
    return rows


def seconds_of(call: Callable[[], object]) -> float:
    """What a call takes, less what looking at the clock takes."""
    first = time.perf_counter()
    started = time.perf_counter()
    call()
    return (time.perf_counter() - started) - (started - first)


def rate(run: Run, model: NativeModel, threads: int) -> float:
    """Steps a second of many instances, each pulled elsewhere and to a target of its own; the best of several times."""
    rng, x = np.random.default_rng(0), run.scene.mesh.vertices
    points = x[spread_points(run.scene, INSTANCES)]
    batch, best = BatchedSimulator(model, INSTANCES, threads), 0.0
    batch.grab(points, points + 0.1 * run.scene.mesh.diagonal * rng.normal(size=points.shape))
    for _ in range(REPEATS):
        started = time.perf_counter()
        batch.step(50)
        best = max(best, 50 * INSTANCES / (time.perf_counter() - started))
    return best


def error_of(run: Run, space: str, motion: str) -> float:
    """Relative, of the whole motion, as the run's report has it."""
    report = json.loads((run.folder / "report" / "report.json").read_text(encoding="utf-8"))
    entry = next(each for each in report["simulate"][space] if each["motion"] == motion)
    return float(entry["online_error"]["relative"])


def frames_of(run: Run, motion: str) -> list[Loads]:
    recorded = run.recorded(motion)
    loads = MotionLoads(recorded.motion, run.scene, dict(recorded.held))
    return [loads.at(frame) for frame in range(min(recorded.motion.frames, FRAMES))]


def shares(run: Run, what: str, seconds: Array) -> list[Row]:
    found = {f"{share} %": float(np.percentile(seconds, share)) for share in (50, 95, 99)} | {"mean": seconds.mean()}
    return [row(run.experiment, f"{what}, {share}", 1e6 * value, "µs") for share, value in found.items()]


def steps_of(run: Run, motion: str, space: Space, model: NativeModel, acting: list[Loads]) -> list[Row]:
    """What the steps of a motion take on each side."""
    seconds = {side: np.full(len(acting), np.inf) for side in ("numba", "C from Python", "C")}
    for _ in range(REPEATS):
        follower, alone = (Follower(NativeSolid(model), space) for _ in range(2))
        found = timed(numba(space), acting), timed(follower.step, acting), timed_alone(alone, acting)
        for side, each in zip(seconds, found, strict=True):
            seconds[side] = np.fmin(seconds[side], each)
    counted = Follower(NativeSolid(model), space)
    made = []
    for frame in acting:
        counted.take(frame)
        made.append(counted.solid.step()[:2])
    what = f"{space.name}, {motion}: "
    names = ("iterations", "evaluations")
    rows = [
        row(run.experiment, f"{what}{name} a step", m, "") for name, m in zip(names, np.mean(made, axis=0), strict=True)
    ]
    for side, least in seconds.items():
        rows += shares(run, what + f"step in {side}", least)
    return rows


def main() -> None:
    options = parser(NAME, __doc__)
    options.add_argument("runs", nargs="+", type=Path, help="folders of finished runs")
    rows: list[Row] = []
    runs = options.parse_args().runs
    with one_thread(), tempfile.TemporaryDirectory() as folder:
        library = Library(build(Path(folder), ("-march=native",)))
        rows += own_part(library)
        for path in runs:
            with Run.open(path) as run:
                for name in REDUCED:
                    rows += measure(run, name, library)
    show(rows)
    write_results(NAME, called(NAME), rows, inputs=["ldsim", "ldsim/runtime/ldsim.c"])


if __name__ == "__main__":
    main()
