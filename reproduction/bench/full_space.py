"""What a frame of the full space costs, in time and memory.

Needs the paper's meshes and recordings in $LDSIM_DATA, and scikit-fem (`pip install '.[dev]'`). One thread. Without
--part all parts run, one after another; each writes reproduction/results/full_space_<part>.json when it is done.
`--part x` can be given repeatedly:

    x        the X while dragging: ours, L-BFGS with the Hessian at rest, and Newton with scikit-fem and SciPy
    beam     all 881 frames of the beam
    dragon   the dragon refined to 454,576 tets, by the direct factor and by multigrid, with peak memory
    scaling  time a frame against cells, 4k … 455k, with the picture for docs/guide/full_space.md
    memory   peak memory of a snapshot run against its frames

Whatever reports memory runs in a process of its own.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ldsim.artefacts.partial import Lease
from ldsim.artefacts.records import write_scene
from ldsim.artefacts.store import Header, file_hash
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.simulate import simulate
from ldsim.jit import one_thread
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.properties import Properties
from ldsim.mechanics.recording import read_recording
from ldsim.mechanics.scene import Scene, make_scene
from ldsim.mesh.formats import read_mesh
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.refine import refined
from ldsim.mesh.shapes import cross
from ldsim.pipeline.ensemble import run_motion
from ldsim.report.svg import PALETTE, new_axes, to_svg
from reproduction.harness import ROOT, Row, called, parser, row, show, write_results

Solver = Literal["auto", "direct", "multigrid"]

NAME = "full_space"
TOLERANCE = 1e-6
FRAME = re.compile(r"median dragging frame, (\d+) cells")
DRAGGING = 20
# Multigrid takes minutes for them on the largest mesh.
DRAGGING_MULTIGRID = 5
# Of each solid: recording, Young's modulus, axis and thickness of the pinned slab (../shared/data/README.md).
SOLIDS = {
    "x": ("x_1", 6e4, 1, 0.001),
    "dragon": ("dragon", 1e5, 1, 0.01),
    "beam": ("beam", 1e5, 0, 0.021),
}
# Mesh and number of refinements, from 4k to 455k cells.
QUICK_SIZES = [("x_538", 1), ("dragon_6216", 0), ("x_29686", 0)]
SIZES = [*QUICK_SIZES, ("beam_45151", 0), ("dragon_56822", 0), ("x_29686", 1), ("dragon_56822", 1)]


@dataclass(frozen=True)
class Replay:
    """Frames of a recording on a mesh, from rest; memory in GiB."""

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
    peak_gib: float

    def json(self) -> str:
        return json.dumps(asdict(self))


def neo_hookean(mesh: Mesh, pinned: NDArray[np.bool_], youngs_modulus: float) -> Scene:
    """A scene of one material throughout, as the paper's; Young's modulus in Pa."""
    properties = Properties.uniform(mesh.n_cells, "neo_hookean", youngs_modulus, 0.47, 1000.0)
    return make_scene(mesh, pinned, properties, (0.0, -9.8, 0.0), 0.005)


def load(mesh_name: str, refinements: int) -> tuple[Scene, Motion]:
    """The scene of a mesh of the paper's, refined some times, and its recording."""
    data = Path(os.environ["LDSIM_DATA"])
    recording, modulus, axis, thickness = SOLIDS[mesh_name.split("_")[0]]
    mesh = read_mesh(data / "meshes" / f"{mesh_name}.mesh").mesh
    for _ in range(refinements):
        mesh = refined(mesh)
    along = mesh.vertices[:, axis]
    scene = neo_hookean(mesh, along <= along.min() + thickness, modulus)
    return scene, read_recording(data / "interactions" / f"{recording}.csv", recording)


def replay(mesh_name: str, refinements: int, count: int, dragging: bool, linear_solver: Solver) -> Replay:
    """Step from rest through the first frames of the recording, or of its first drag."""
    started = time.perf_counter()
    scene, motion = load(mesh_name, refinements)
    stepper = FullStepper(scene, FullOptions(tolerance=TOLERANCE, linear_solver=linear_solver))
    first = motion.drags[0].start if dragging else 0
    compile_step()
    setup = time.perf_counter() - started
    name = f"{mesh_name} refined {refinements}×" if refinements else mesh_name
    wanted = range(first, min(first + count, motion.frames))
    frames = list(tqdm(simulate(stepper, motion, frames=wanted), name, len(wanted), unit="frame", mininterval=5))
    seconds, solutions = [frame.seconds for frame in frames], [frame.solution for frame in frames]
    return Replay(
        name,
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
        len(frames) == len(wanted) and all(s.converged for s in solutions),
        peak_gib(),
    )


def peak_gib() -> float:
    """Largest resident memory of this process so far, GiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def compile_step() -> None:
    """Compile, or load, what a step needs, so that no timed frame does; on a small solid."""
    small = cross(resolution=1)
    pinned = small.vertices[:, 1] < small.vertices[:, 1].min() + 1e-9
    stepper = FullStepper(neo_hookean(small, pinned, 1e5))
    stepper.step(stepper.rest(), Loads())


def snapshot_peak(frames: int) -> float:
    """Peak memory of a snapshot run of a cross over some frames, GiB."""
    mesh = cross(resolution=4)
    pinned = mesh.vertices[:, 1] < mesh.vertices[:, 1].min() + 1e-9
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.h5"
        write_scene(path, Header("scene", "", {}, -1, {}), neo_hookean(mesh, pinned, 4e4))
        partial = Path(folder) / "partial"
        partial.mkdir()
        run_motion(
            path, Lease.taken(partial), Motion("hang", frames), FullOptions(tolerance=TOLERANCE), file_hash(path)
        )
    return peak_gib()


def in_child(expression: str) -> str:
    """What an expression of this file gives, printed as JSON, in a process of its own."""
    code = f"from reproduction.bench.full_space import *\nwith one_thread(): print({expression})"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    return done.stdout.splitlines()[-1]


def replay_in_child(
    mesh_name: str, refinements: int, count: int, dragging: bool = True, linear_solver: Solver = "auto"
) -> Replay:
    """`replay` in a process of its own; a frame that did not converge is an error."""
    arguments = (mesh_name, refinements, count, dragging, linear_solver)
    result = Replay(**json.loads(in_child(f"replay{arguments!r}.json()")))
    if not result.converged:
        raise RuntimeError(f"a frame of {result.model} did not converge ({result.solver})")
    return result


def x(quick: bool) -> list[Row]:
    from reproduction.rivals.full_space_rivals import measure

    name = "x_538" if quick else "x_29686"
    return measure(name, *load(name, 0), 10 if quick else 50, TOLERANCE)


def beam(quick: bool) -> list[Row]:
    p = replay_in_child("beam_3042" if quick else "beam_45151", 0, 60 if quick else 881, dragging=False)
    return [
        row(p.model, f"replay of {p.frames} frames", p.total_s / 60, "min", "<= 25"),
        row(p.model, "median frame", p.median_ms, "ms"),
        row(p.model, "slowest frame", p.slowest_ms, "ms"),
        row(p.model, "iterations a frame", p.iterations),
        row(p.model, "factorisations", p.factorisations),
        row(p.model, "preparation", p.setup_s, "s"),
        row(p.model, "peak memory", p.peak_gib, "GiB"),
    ]


def dragon(quick: bool) -> list[Row]:
    rows = []
    wanted: list[tuple[Solver, int]] = [("auto", DRAGGING), ("multigrid", DRAGGING_MULTIGRID)]
    for solver, frames in wanted:
        mesh = ("dragon_6216", 0, 3) if quick else ("dragon_56822", 1, frames)
        p = replay_in_child(*mesh, linear_solver=solver)
        label = f"{p.cells} cells, {p.frames} dragging frames, {p.solver.split(',')[0]}"
        rows += [
            row(p.model, f"{label}: mean frame", p.total_s / p.frames, "s"),
            row(p.model, f"{label}: slowest frame", p.slowest_ms / 1e3, "s"),
            row(p.model, f"{label}: iterations a frame", p.iterations),
            row(p.model, f"{label}: preparation", p.setup_s, "s"),
            row(p.model, f"{label}: peak memory", p.peak_gib, "GiB", "<= 16"),
        ]
    return rows


def scaling(quick: bool) -> list[Row]:
    sizes, count = (QUICK_SIZES, 5) if quick else (SIZES, DRAGGING)
    points = [replay_in_child(mesh_name, refinements, count) for mesh_name, refinements in sizes]
    cells, ms = np.array([[p.cells, p.median_ms] for p in points]).T
    exponent = np.polyfit(np.log(cells), np.log(ms), 1)[0]
    rows = [row("all", "exponent of the median dragging frame against cells", float(exponent))]
    for p in points:
        rows.append(row(p.model, f"median dragging frame, {p.cells} cells", p.median_ms, "ms"))
        rows.append(row(p.model, f"iterations a dragging frame, {p.cells} cells", p.iterations))
        rows.append(row(p.model, f"peak memory, {p.cells} cells", p.peak_gib, "GiB"))
    return rows


def picture(rows: Sequence[Row]) -> str:
    """Time a frame against cells, both logarithmic, with the fitted power."""
    frames = [(int(told[1]), r["value"]) for r in rows if (told := FRAME.fullmatch(r["quantity"]))]
    cells, ms = np.array(frames).T
    exponent, constant = np.polyfit(np.log(cells), np.log(ms), 1)
    figure, ax = new_axes("cells (tet4)", "median frame while dragging, ms")
    ax.loglog(cells, ms, "o", color=PALETTE["full"])
    ends = np.array([cells.min(), cells.max()])
    ax.loglog(
        ends, np.exp(constant) * ends**exponent, color=PALETTE["latent"], label=f"proportional to cells^{exponent:.2f}"
    )
    ax.legend(frameon=False, fontsize=8, labelcolor="#23282f")
    return to_svg(figure, "Median time of a full-space frame while dragging, against the number of cells")


def memory(quick: bool) -> list[Row]:
    short, long = (float(in_child(f"snapshot_peak({frames})")) for frames in ((20, 80) if quick else (50, 800)))
    return [row("cross", "peak memory of snapshot, long run over short", long / short, "", "<= 1.1")]


PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "x": x,
    "beam": beam,
    "dragon": dragon,
    "scaling": scaling,
    "memory": memory,
}


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("--part", action="append", choices=PARTS, help="only this part; may be given repeatedly")
    arguments.add_argument("--quick", action="store_true", help="small meshes; results/full_space_<part>_quick.json")
    given = arguments.parse_args()
    if "LDSIM_DATA" not in os.environ:
        arguments.error("set LDSIM_DATA to the folder that holds the paper's meshes/ and interactions/")
    with one_thread():
        for part in given.part or PARTS:
            rows = PARTS[part](given.quick)
            show(rows, part)
            print(write_results(f"{NAME}_{part}{'_quick' if given.quick else ''}", called(NAME), rows))


if __name__ == "__main__":
    main()
