"""Steps a second against the number of instances: python benchmarks/batched.py runs/x [--quick]

All instances of a finished run's latent model step together, each pulled at a vertex, in a direction and with a
stiffness of its own; on one CPU core and, where there is one, on a GPU, in double and single precision. Beside them the
serial stepper, which takes the same steps one instance after another. `--quick` takes three sizes. The results are
written after each size.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import torch
from results_file import write_results

from ldsim.artefacts.records import read_basis, read_cubature, read_model, read_scene
from ldsim.dynamics.batched import BatchedState, BatchedStepper
from ldsim.dynamics.reduced.stepper import ReducedState, ReducedStepper
from ldsim.jit import one_thread
from ldsim.mechanics.loads import Grab
from ldsim.mechanics.scene import Scene
from ldsim.mesh.surface import surface_vertices
from ldsim.report.machine import describe_machine

SIZES = (1, 4, 16, 64, 256, 1024, 4096, 16384)
QUICK = (1, 16, 128)
WARM_UP, TIMED = 3, 10
# A run on the CPU stops growing when the last size took longer than this, seconds.
LONGEST = 120.0
TOLERANCE = {torch.float64: 1e-8, torch.float32: 1e-3}


def pulls(scene: Scene, count: int) -> list[list[Grab]]:
    """One grab of a random part of the surface an instance."""
    rng = np.random.default_rng(0)
    x, size = scene.mesh.vertices, scene.mesh.diagonal
    surface = np.intersect1d(surface_vertices(scene.mesh), scene.free)
    held = []
    for vertex in rng.choice(surface, size=min(64, len(surface)), replace=False):
        near = np.flatnonzero((np.linalg.norm(x - x[vertex], axis=1) < 0.1 * size) & scene.movable)
        held.append((near, x[near].mean(axis=0)))
    grabs = []
    for i in range(count):
        vertices, centre = held[i % len(held)]
        grabs.append([Grab(vertices, centre + 0.1 * size * rng.normal(size=3), float(rng.uniform(10, 50)))])
    return grabs


def batched_rate(stepper: BatchedStepper, grabs: list[list[Grab]]) -> tuple[float, float, float]:
    """Steps of an instance a second, iterations a step, and the share that converged."""
    conditions, state = stepper.conditions(grabs), stepper.at_rest(len(grabs))
    iterations, converged = 0.0, 0.0

    def steps(state: BatchedState, count: int) -> BatchedState:
        nonlocal iterations, converged
        for _ in range(count):
            state, solution = stepper.step(state, conditions)
            iterations += float(solution.iterations.double().mean()) / count
            converged += float(solution.converged.double().mean()) / count
        if stepper.device.type == "cuda":
            torch.cuda.synchronize()
        return state

    state = steps(state, WARM_UP)
    iterations, converged = 0.0, 0.0
    started = time.perf_counter()
    steps(state, TIMED)
    return len(grabs) * TIMED / (time.perf_counter() - started), iterations, converged


def serial_rate(stepper: ReducedStepper, grabs: list[list[Grab]]) -> float:
    """Steps a second, one instance after another."""
    spent = 0.0
    for some in grabs:
        state = ReducedState.at_rest(stepper.decoder)
        for _ in range(WARM_UP):
            state, _ = stepper.step(state, some)
        started = time.perf_counter()
        for _ in range(TIMED):
            state, _ = stepper.step(state, some)
        spent += time.perf_counter() - started
    return len(grabs) * TIMED / spent


def main(folder: Path, sizes: tuple[int, ...]) -> None:
    scene, _ = read_scene(folder / "scene.h5")
    U = read_basis(folder / "basis.h5")[0].basis.U
    decoder = read_model(folder / "model.h5")[0].decoder
    cubature = read_cubature(folder / "cubature.h5")[0]["latent"].stepped
    model, rows = folder.name, []

    def note(quantity: str, value: float, unit: str) -> None:
        rows.append({"model": model, "quantity": quantity, "value": value, "unit": unit, "goal": None})
        print(f"{model}: {quantity}: {value:.4g} {unit}", flush=True)

    grabs = pulls(scene, max(sizes))
    note("latent dimension", decoder.r, "")
    note("cubature points", len(cubature.points), "")
    with one_thread():
        torch.set_num_threads(1)
        serial = ReducedStepper(scene, U, decoder, cubature)
        serial_rate(serial, grabs[:1])
        note("serial", serial_rate(serial, grabs[:16]), "steps/s")
        for device in ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",):
            for dtype in (torch.float64, torch.float32):
                stepper = BatchedStepper(
                    scene, U, decoder, cubature,
                    tolerance=TOLERANCE[dtype], device=device, dtype=dtype,
                )  # fmt: skip
                for size in sizes:
                    started = time.perf_counter()
                    rate, iterations, converged = batched_rate(stepper, grabs[:size])
                    name = f"{device} {str(dtype).removeprefix('torch.')}, {size} instances"
                    note(f"batched on {name}", rate, "steps/s")
                    note(f"iterations a step on {name}", iterations, "")
                    note(f"converged on {name}", converged, "share")
                    write(folder, rows, sizes == QUICK)
                    if device == "cpu" and time.perf_counter() - started > LONGEST:
                        break


def write(folder: Path, rows: list[dict[str, object]], quick: bool) -> None:
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else None
    command = f"python benchmarks/batched.py runs/{folder.name}{' --quick' if quick else ''}"
    write_results(f"batched_{folder.name}", command, rows, machine=describe_machine() | {"gpu": gpu})


if __name__ == "__main__":
    folders = [Path(argument) for argument in sys.argv[1:] if argument != "--quick"]
    if len(folders) != 1:
        sys.exit("usage: python benchmarks/batched.py runs/EXPERIMENT [--quick] (a finished run)")
    main(folders[0], QUICK if "--quick" in sys.argv else SIZES)
