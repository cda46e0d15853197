"""Attacks on what a user writes: configurations, meshes, surfaces and recordings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.recording import read_recording, write_recording
from ldsim.mesh.formats import read_surface
from ldsim.mesh.repair import repaired
from ldsim.run import Run
from reproduction.faults.alone import here, invoke, outcome, told
from reproduction.faults.artefacts import Found
from reproduction.faults.bench import EXPERIMENTS, Bench
from reproduction.faults.mutations import text_spoilt

CORNERS = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
SURFACE = f"OFF\n4 4 6\n{CORNERS}3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"


def configurations(bench: Bench, rng: np.random.Generator) -> Found:
    """A spoilt configuration."""
    path = bench.folder / "spoilt.yaml"
    whole = bench.config(str(rng.choice(EXPERIMENTS))).read_text(encoding="utf-8")
    path.write_text(text_spoilt(whole, rng), encoding="utf-8")
    said = here(lambda: outcome(invoke("settings", path)))
    bench.keep(said, f"{rng.integers(2**32)}.yaml", path.read_bytes())
    yield "configurations", said, path.name


def files(bench: Bench, rng: np.random.Generator) -> Found:
    """A spoilt mesh, surface or recording."""
    suffix = str(rng.choice(["mesh", "off", "csv"]))
    path = bench.folder / f"a.{suffix}"
    read: dict[str, Callable[[], str]] = {
        "mesh": lambda: _mesh(bench, path),
        "off": lambda: told(lambda: repaired(read_surface(path))),
        "csv": lambda: told(lambda: read_recording(path, "a")),
    }
    whole: dict[str, Callable[[], str]] = {
        "mesh": lambda: _mesh_text(bench),
        "off": lambda: SURFACE,
        "csv": lambda: _recording_text(bench),
    }
    path.write_text(text_spoilt(whole[suffix](), rng), encoding="utf-8")
    said = here(read[suffix])
    bench.keep(said, f"{rng.integers(2**32)}.{suffix}", path.read_bytes())
    yield "meshes and recordings", said, path.name


def _mesh_text(bench: Bench) -> str:
    with Run(bench.whole / "small", "small") as run:
        mesh = run.scene.mesh
    points = "\n".join(" ".join(map(repr, map(float, x))) + " 0" for x in mesh.vertices)
    cells = "\n".join(" ".join(str(i + 1) for i in cell) + " 0" for cell in mesh.cells)
    return (
        f"MeshVersionFormatted 1\nDimension 3\nVertices\n{len(mesh.vertices)}\n{points}\nTetrahedra\n"
        f"{len(mesh.cells)}\n{cells}\nEnd\n"
    )


def _mesh(bench: Bench, path: Path) -> str:
    config = bench.folder / "files.yaml"
    config.write_text(
        f"experiment: files\nmesh:\n  file: {path.name}\n  material: {{youngs_modulus: 40000.0}}\n  pins:\n"
        "  - slab: {axis: y, thickness: 0.001}\nsnapshot: {motions: [{name: a, recording: a.csv}]}\n",
        encoding="utf-8",
    )
    return outcome(invoke("mesh", config, "--runs", bench.folder / "files"))


def _recording_text(bench: Bench) -> str:
    pull = Drag(2, np.zeros(3), np.random.default_rng(1).normal(size=(30, 3)), 0.02, 30.0)
    path = bench.folder / "whole.csv"
    write_recording(path, Motion("a", 40, (pull,)))
    return path.read_text(encoding="utf-8")
