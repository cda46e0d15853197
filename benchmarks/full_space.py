"""What a frame of the full space costs, in time and memory: LDSIM_DATA=… python benchmarks/full_space.py [--quick]

Needs the paper's meshes and recordings, and scikit-fem (`pip install '.[dev]'`). One thread. Every measurement that
reports memory runs in a process of its own.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import write_scene
from ldsim.artefacts.store import Header
from ldsim.dynamics.full import FullState, FullStepper
from ldsim.dynamics.linear_choice import choose
from ldsim.dynamics.potential import IncrementalPotential
from ldsim.dynamics.preconditioner import TurnedHessian
from ldsim.ensemble import SolverOptions, run_motion
from ldsim.evaluation.machine import describe_machine
from ldsim.mechanics.motion import Grab, GrabTracker, Motion
from ldsim.mechanics.recording import read_recording
from ldsim.mechanics.scene import Scene, uniform_scene
from ldsim.mesh.formats import read_mesh
from ldsim.mesh.refine import refined
from ldsim.mesh.shapes import cross
from ldsim.solvers.lbfgs import minimise
from ldsim.threads import one_thread

Array = NDArray[np.float64]
Row = dict[str, object]

TOLERANCE = 1e-6
WARM_UP = 3
RESULTS = Path(__file__).parent / "results"
PICTURE = Path(__file__).parent.parent / "docs" / "pictures" / "full_space_scaling.png"
# Of each solid: recording, Young's modulus, axis and thickness of the pinned slab (../shared/data/README.md).
SOLIDS = {
    "x": ("x_1", 6e4, 1, 0.001),
    "dragon": ("dragon", 1e5, 1, 0.01),
    "beam": ("beam", 1e5, 0, 0.021),
}
# Mesh and number of refinements, from 4k to 455k cells.
SIZES = [("x_538", 1), ("dragon_6216", 0), ("x_29686", 0), ("beam_45151", 0), ("dragon_56822", 0)]
SIZES += [("x_29686", 1), ("dragon_56822", 1)]
QUICK_SIZES = [("x_538", 1), ("dragon_6216", 0), ("x_29686", 0)]


@dataclass(frozen=True)
class Replay:
    """Dragging frames of a recording on a mesh, from rest."""

    model: str
    cells: int
    vertices: int
    solver: str
    frames: int
    setup_s: float
    median_ms: float
    slowest_ms: float
    total_s: float
    iterations: float
    evaluations: float
    factorisations: int
    converged: bool
    peak_mb: float


def load(mesh_name: str, refinements: int) -> tuple[Scene, Motion]:
    """The scene of a mesh of the paper's, refined some times, and its recording."""
    data = Path(os.environ["LDSIM_DATA"])
    recording, modulus, axis, thickness = SOLIDS[mesh_name.split("_")[0]]
    mesh = read_mesh(data / "meshes" / f"{mesh_name}.mesh").mesh
    for _ in range(refinements):
        mesh = refined(mesh)
    along = mesh.vertices[:, axis]
    scene = uniform_scene(mesh, along <= along.min() + thickness, youngs_modulus=modulus)
    return scene, read_recording(data / "interactions" / f"{recording}.csv", recording)


def replay(mesh_name: str, refinements: int, count: int, linear_solver: str) -> Replay:
    """Step from rest through the first frames of the first drag, or, with count 0, through the whole recording."""
    started = time.perf_counter()
    scene, motion = load(mesh_name, refinements)
    stepper = FullStepper(scene, TOLERANCE, linear_solver=linear_solver)
    tracker = GrabTracker(motion, scene.mesh.vertices, scene.movable)
    state = FullState.at_rest(scene.mesh.n_vertices)
    first = motion.drags[0].start if count else 0
    compile_step()
    setup = time.perf_counter() - started
    seconds, solutions = [], []
    for frame in range(first, first + count if count else motion.frames):
        grabs = tracker.grabs(frame, state.u)
        started = time.perf_counter()
        state, solution = stepper.step(state, grabs)
        seconds.append(time.perf_counter() - started)
        solutions.append(solution)
    return Replay(
        f"{mesh_name} refined {refinements}×" if refinements else mesh_name,
        scene.mesh.n_cells,
        scene.mesh.n_vertices,
        stepper.choice.words,
        len(seconds),
        setup,
        1e3 * float(np.median(seconds)),
        1e3 * max(seconds),
        sum(seconds),
        float(np.mean([s.iterations for s in solutions])),
        float(np.mean([s.evaluations for s in solutions])),
        stepper.factorisations,
        all(s.converged for s in solutions),
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6,
    )


def compile_step() -> None:
    """Compile, or load, what a step needs, so that no timed frame does; on a small solid."""
    small = cross(resolution=1)
    pinned = small.vertices[:, 1] < small.vertices[:, 1].min() + 1e-9
    FullStepper(uniform_scene(small, pinned)).step(FullState.at_rest(small.n_vertices), [])


def in_child(task: str, *arguments: object) -> dict[str, object]:
    """Run a task of this file in a process of its own; its last line is JSON."""
    command = [sys.executable, __file__, "--child", task, *(str(argument) for argument in arguments)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    result: dict[str, object] = json.loads(done.stdout.splitlines()[-1])
    return result


def snapshot_peak(frames: int) -> dict[str, float]:
    """Peak memory of a snapshot run of a cross against its frames, MB."""
    mesh = cross(resolution=4)
    pinned = mesh.vertices[:, 1] < mesh.vertices[:, 1].min() + 1e-9
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.h5"
        write_scene(path, Header("scene", "", {}, -1, {}), uniform_scene(mesh, pinned, youngs_modulus=4e4))
        run_motion(path, Path(folder) / "partial", Motion("hang", frames, ()), SolverOptions(TOLERANCE, 25, 500))
    return {"peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6}


class RestStepper:
    """L-BFGS preconditioned by the Hessian at rest, as the paper's text has it; the same stop rule and line search."""

    def __init__(self, scene: Scene) -> None:
        n = scene.mesh.n_vertices
        self._scene = scene
        self._hessian = TurnedHessian(scene, choose(scene, "direct"), exact=False)
        self._hessian.factorise(np.zeros((n, 3)))
        self._hessian.prepare(np.zeros((n, 3)), [])

    def step(self, u: Array, u_previous: Array, grabs: list[Grab]) -> tuple[Array, int]:
        potential = IncrementalPotential(self._scene, 2 * u - u_previous, grabs)
        x, scratch = (2 * u - u_previous).ravel(), np.empty(u.size)
        if not potential.value_gradient(x, scratch) < potential.value_gradient(u.ravel(), scratch):
            x = u.ravel().copy()
        solution = minimise(potential.value_gradient, x, self._hessian.solve, TOLERANCE, max_iterations=2000)
        assert solution.converged, solution.reason.words
        return x.reshape(-1, 3), solution.iterations


def rivals(mesh_name: str, count: int, every: int) -> tuple[list[tuple[str, float, float, float]], list[Row]]:
    """Ours on frames of the first drag; the others on every few of them, each from the same two states as ours."""
    from scikit_fem_step import ScikitFemStepper

    scene, motion = load(mesh_name, 0)
    tracker = GrabTracker(motion, scene.mesh.vertices, scene.movable)
    stepper, state = FullStepper(scene, TOLERANCE), FullState.at_rest(scene.mesh.n_vertices)
    others = {"L-BFGS, Hessian at rest": RestStepper(scene), "scikit-fem, SciPy": ScikitFemStepper(scene, TOLERANCE)}
    times: dict[str, list[float]] = {"ours": [], **{name: [] for name in others}}
    iterations: dict[str, list[int]] = {name: [] for name in times}
    worst = dict.fromkeys(times, 0.0)
    first = motion.drags[0].start
    for i, frame in enumerate(range(first - WARM_UP, first + count)):
        grabs = tracker.grabs(frame, state.u)
        before = state
        started = time.perf_counter()
        state, solution = stepper.step(before, grabs)
        if i < WARM_UP:
            continue
        times["ours"].append(time.perf_counter() - started)
        iterations["ours"].append(solution.iterations)
        if (frame - first) % every:
            continue
        for name, other in others.items():
            started = time.perf_counter()
            u, used = other.step(before.u, before.u_previous, grabs)
            times[name].append(time.perf_counter() - started)
            iterations[name].append(used)
            worst[name] = max(worst[name], float(np.linalg.norm(u - state.u, axis=1).max()))
    table = [(n, 1e3 * float(np.mean(t)), float(np.mean(iterations[n])), 1e3 * worst[n]) for n, t in times.items()]
    ours = table[0][1]
    rows: list[Row] = [row(mesh_name, f"mean frame while dragging, {n}", ms, "ms") for n, ms, _, _ in table]
    rows.append(row(mesh_name, "rest-preconditioned L-BFGS over ours", table[1][1] / ours, "", ">= 3"))
    rows.append(row(mesh_name, "scikit-fem and SciPy over ours", table[2][1] / ours, "", ">= 5"))
    rows.append(row(mesh_name, "median frame while dragging, ours", 1e3 * float(np.median(times["ours"])), "ms"))
    return table, rows


def row(model: str, quantity: str, value: object, unit: str, goal: str | None = None) -> Row:
    return {"model": model, "quantity": quantity, "value": value, "unit": unit, "goal": goal}


def draw(points: list[dict[str, object]], exponent: float, factor: float) -> None:
    """Time a frame against cells, both logarithmic, with the fitted power."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    cells = np.array([float(str(p["cells"])) for p in points])
    ms = np.array([float(str(p["median_ms"])) for p in points])
    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    axes.loglog(cells, ms, "o")
    line = np.array([cells.min(), cells.max()])
    axes.loglog(line, factor * line**exponent, "-", label=f"∝ cells^{exponent:.2f}")
    axes.set_xlabel("cells (tet4)")
    axes.set_ylabel("median frame while dragging, ms")
    axes.legend()
    figure.savefig(PICTURE, dpi=120)


def scaling(sizes: list[tuple[str, int]], count: int) -> tuple[list[dict[str, object]], list[Row]]:
    """Time a frame against cells, each size in a process of its own."""
    print("\n| mesh | cells | solver | median ms | slowest ms | iterations | factorisations | peak MB |")
    print("|---|---|---|---|---|---|---|---|")
    points = []
    for mesh_name, refinements in sizes:
        p = in_child("replay", mesh_name, refinements, count, "auto")
        points.append(p)
        keys = ("model", "cells", "solver", "median_ms", "slowest_ms", "iterations", "factorisations", "peak_mb")
        print(
            "| " + " | ".join(f"{p[k]:.3g}" if isinstance(p[k], float) else f"{p[k]}" for k in keys) + " |", flush=True
        )
    logs = np.log([[float(str(p["cells"])), float(str(p["median_ms"]))] for p in points])
    exponent, constant = np.polyfit(logs[:, 0], logs[:, 1], 1)
    rows = [row(str(p["model"]), f"median frame, {p['cells']} cells", p["median_ms"], "ms") for p in points]
    rows.append(row("all", "exponent of time a frame against cells", float(exponent), ""))
    return points, [*rows, row("all", "constant of the fitted power", float(np.exp(constant)), "ms")]


def large(mesh_name: str, refinements: int, count: int) -> list[Row]:
    """The largest mesh by the direct factor (if auto takes it) and by multigrid: seconds a frame and peak memory."""
    rows = []
    for solver in ("auto", "multigrid"):
        p = in_child("replay", mesh_name, refinements, count, solver)
        assert p["converged"], p
        label = f"{p['cells']} cells, {p['frames']} dragging frames, {str(p['solver']).split(',')[0]}"
        rows.append(row(str(p["model"]), f"{label}: seconds a frame", float(str(p["median_ms"])) / 1e3, "s"))
        rows.append(row(str(p["model"]), f"{label}: peak memory", float(str(p["peak_mb"])) / 1e3, "GB", "<= 16"))
    return rows


def main(quick: bool) -> None:
    table, rows = rivals("x_538" if quick else "x_29686", 10 if quick else 50, 5)
    print("| solver | mean ms a frame | iterations | farthest vertex from ours, mm |\n|---|---|---|---|")
    for name, ms, iterations, apart in table:
        print(f"| {name} | {ms:.1f} | {iterations:.1f} | {apart:.2g} |", flush=True)
    points, more = scaling(QUICK_SIZES if quick else SIZES, 5 if quick else 20)
    rows += more
    rows += large("dragon_6216" if quick else "dragon_56822", 0 if quick else 1, 3 if quick else 20)
    short, long = (in_child("snapshot", frames)["peak_mb"] for frames in ((20, 80) if quick else (50, 800)))
    rows.append(
        row("cross", "peak memory of snapshot, long run over short", float(str(long)) / float(str(short)), "", "<= 1.1")
    )
    if not quick:
        beam = in_child("replay", "beam_45151", 0, 0, "auto")
        rows.append(row("beam_45151", "replay of 881 frames", float(str(beam["total_s"])) / 60, "min", "<= 25"))
        draw(points, float(str(more[-2]["value"])), float(str(more[-1]["value"])))
        write(rows)
    print()
    for entry in rows:
        print(f"{entry['model']}: {entry['quantity']} = {float(str(entry['value'])):.4g} {entry['unit']}", end="")
        print(f", goal {entry['goal']}" if entry["goal"] else "")


def write(rows: list[Row]) -> None:
    described = describe_machine()
    content = {
        "machine": {key: value for key, value in described.items() if key != "versions"},
        "versions": described["versions"],
        "command": "python benchmarks/full_space.py",
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "rows": rows,
    }
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "full_space.json").write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    if "LDSIM_DATA" not in os.environ:
        sys.exit("set LDSIM_DATA to the folder that holds the paper's meshes/ and interactions/")
    with one_thread():
        if sys.argv[1:2] == ["--child"] and sys.argv[2] == "snapshot":
            print(json.dumps(snapshot_peak(int(sys.argv[3]))))
        elif sys.argv[1:2] == ["--child"]:
            name, refinements, count, solver = sys.argv[3:]
            print(json.dumps(asdict(replay(name, int(refinements), int(count), solver))))
        else:
            main("--quick" in sys.argv)
