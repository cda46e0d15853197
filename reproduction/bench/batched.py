"""Steps a second against the number of instances.

All instances of a finished run's latent model step together, each pulled at a vertex, in a direction and with a
stiffness of its own: on a CPU, in double precision by one thread and by one a core, and in single precision, and where
there is one on a GPU. Beside them the serial stepper, which takes the same steps one instance after another. `--quick`
takes three sizes, `--device cuda` the graphics card alone. The results are written after each size.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from ldsim.dynamics.batched import BatchedStepper
from ldsim.dynamics.batched.newton import BatchedSolution
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.jit import one_thread
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.scene import Scene
from ldsim.mesh.surface import surface_vertices
from ldsim.report.machine import describe_machine
from ldsim.run import Run
from ldsim.space.space import Space
from reproduction.harness import Row, called, parser, row, show, write_results

NAME = "batched"
ROOMS = ("ldsim/dynamics/batched", "ldsim/dynamics/reduced")
SIZES = (1, 4, 16, 64, 256, 1024, 4096, 16384)
QUICK = (1, 16, 128)
WARM_UP, TIMED = 3, 40
REPEATS = 3  # of which the fastest counts, on either side
# A run on the CPU stops growing when the last size took longer than this, seconds.
LONGEST = 120.0
TOLERANCE = {torch.float64: 1e-8, torch.float32: 1e-3}


def pulls(scene: Scene, count: int) -> list[Loads]:
    """One grab of a random part of the surface an instance."""
    rng = np.random.default_rng(0)
    x, size = scene.mesh.vertices, scene.mesh.diagonal
    surface = np.intersect1d(surface_vertices(scene.mesh), scene.free)
    held = []
    for vertex in rng.choice(surface, size=min(64, len(surface)), replace=False):
        near = np.flatnonzero((np.linalg.norm(x - x[vertex], axis=1) < 0.1 * size) & scene.movable)
        held.append((near, x[near].mean(axis=0)))
    loads = []
    for i in range(count):
        vertices, centre = held[i % len(held)]
        grab = Grab(vertices, centre + 0.1 * size * rng.normal(size=3), float(rng.uniform(10, 50)))
        loads.append(Loads((grab,)))
    return loads


def batched_rate(stepper: BatchedStepper, loads: list[Loads]) -> tuple[float, float, float]:
    """Steps of an instance a second, iterations a step, and the share that converged."""
    acting, state = stepper.loads(loads), stepper.rest(len(loads))
    for _ in range(WARM_UP):
        state, _ = stepper.step(state, acting)
    solutions: list[BatchedSolution] = []
    moving, best = state, float("inf")
    for _ in range(REPEATS):
        state = moving
        _finish(stepper)
        started = time.perf_counter()
        for _ in range(TIMED):
            state, solution = stepper.step(state, acting)
            solutions.append(solution)
        _finish(stepper)
        best = min(best, time.perf_counter() - started)
    rate = len(loads) * TIMED / best
    iterations = np.mean([float(each.iterations.double().mean()) for each in solutions])
    return rate, float(iterations), float(np.mean([float(each.converged.double().mean()) for each in solutions]))


def _finish(stepper: BatchedStepper) -> None:
    """Wait for a graphics card."""
    if stepper.device.type == "cuda":
        torch.cuda.synchronize()


def serial_rate(stepper: ReducedStepper, loads: list[Loads]) -> float:
    """Steps a second, one instance after another."""
    spent = 0.0
    for acting in loads:
        state = stepper.rest()
        for _ in range(WARM_UP):
            state, _ = stepper.step(state, acting)
        started = time.perf_counter()
        for _ in range(TIMED):
            state, _ = stepper.step(state, acting)
        spent += time.perf_counter() - started
    return len(loads) * TIMED / spent


def measure(name: str, model: str, space: Space, sizes: tuple[int, ...], only: str | None) -> None:
    """Measure and write all sizes of one model, on one device or on all."""
    rows: list[Row] = []

    def note(quantity: str, value: float, unit: str) -> None:
        rows.append(row(model, quantity, value, unit))
        show(rows[-1:])

    loads = pulls(space.scene, max(sizes))
    note("latent dimension", space.r, "")
    note("cubature points", len(space.rule.points), "")
    serial = ReducedStepper(space, ReducedOptions(tolerance=TOLERANCE[torch.float64]))
    serial_rate(serial, loads[:1])
    note("serial", max(serial_rate(serial, loads[:16]) for _ in range(REPEATS)), "steps/s")
    for device, dtype, threads in ways(only):
        stepper = BatchedStepper(space, tolerance=TOLERANCE[dtype], device=device, dtype=dtype)
        torch.set_num_threads(threads)
        for size in sizes:
            started = time.perf_counter()
            rate, iterations, converged = batched_rate(stepper, loads[:size])
            how = f"{device} {str(dtype).removeprefix('torch.')}, {threads} threads, {size} instances"
            note(f"batched on {how}", rate, "steps/s")
            note(f"iterations a step on {how}", iterations, "")
            note(f"converged on {how}", converged, "share")
            write(name, rows)
            if device == "cpu" and time.perf_counter() - started > LONGEST:
                break
    note("serial, again", max(serial_rate(serial, loads[:16]) for _ in range(REPEATS)), "steps/s")
    write(name, rows)


def ways(only: str | None) -> Iterator[tuple[str, torch.dtype, int]]:
    """Device, type and threads."""
    cores = len(os.sched_getaffinity(0))
    found = [("cpu", torch.float64, threads) for threads in sorted({1, cores})] + [("cpu", torch.float32, 1)]
    if torch.cuda.is_available():
        found += [("cuda", dtype, 1) for dtype in (torch.float64, torch.float32)]
    yield from (each for each in found if only in (None, each[0]))


def write(name: str, rows: list[Row]) -> None:
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else None
    write_results(name, called(NAME), rows, machine=describe_machine() | {"gpu": gpu}, inputs=ROOMS)


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("run", type=Path, help="folder of a finished run")
    arguments.add_argument("--quick", action="store_true", help="three sizes")
    arguments.add_argument("--device", choices=("cpu", "cuda"), help="this one alone")
    given = arguments.parse_args()
    model, sizes = given.run.name, QUICK if given.quick else SIZES
    name = "_".join([NAME, model, *([given.device] if given.device else []), *(["quick"] if given.quick else [])])
    with Run.open(given.run) as run, one_thread():
        measure(name, model, run.space("latent"), sizes, given.device)


if __name__ == "__main__":
    main()
