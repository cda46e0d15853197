"""`ldsim mesh` with a surface: what is printed and stored, and when the tets are made anew. fTetWild is a stand-in."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from ldsim.artefacts.records import read_scene
from ldsim.mesh.shapes import beam
from ldsim.mesh.tetrahedralize import Tetrahedralization
from ldsim.mesh.triangles import Triangles
from ldsim.pipeline import mesh as stage
from tests.cli.experiments import TINY, Experiment
from tests.mesh.surfaces import soup, surface_of


class FTetWild:
    """Fills every surface with a beam, each time another one."""

    def __init__(self) -> None:
        self.calls: list[tuple[object, ...]] = []

    def __call__(self, surface: Triangles, *arguments: object) -> Tetrahedralization:
        self.calls.append(arguments)
        mesh = beam(0.4 + 0.01 * len(self.calls), resolution=2)
        return Tetrahedralization(mesh, 0.05, surface.volume)


@pytest.fixture
def experiment(tmp_path: Path) -> Experiment:
    """A folder for an experiment of which nothing has run."""
    return Experiment(tmp_path)


@pytest.fixture
def ftetwild(monkeypatch: pytest.MonkeyPatch) -> FTetWild:
    stand_in = FTetWild()
    monkeypatch.setattr(stage, "tetrahedralized", stand_in)
    monkeypatch.setattr(stage, "tetrahedralized_to_count", stand_in)
    return stand_in


def write(path: Path, surface: Triangles) -> None:
    meshio.Mesh(surface.vertices * 1000, [("triangle", surface.faces)]).write(path)


def configure(experiment: Experiment, **changes: Any) -> None:
    """A beam's surface in millimetres, in three vertices a triangle."""
    path = experiment.folder / "beam.off"
    if not path.exists():
        write(path, soup(surface_of("beam")))
    content = copy.deepcopy(TINY)
    del content["mesh"]["shape"]
    content["mesh"] |= {
        "surface": {"file": "beam.off", "edge_length": 0.05},
        "scale": 0.001,
        "pins": [{"slab": {"axis": "x", "thickness": 0.01}}],
    }
    content["mesh"] |= changes
    experiment.configure(content)


def test_the_tets_their_quality_and_the_repairs_are_told_and_stored(experiment: Experiment, ftetwild: FTetWild) -> None:
    configure(experiment)
    result = experiment.invoke("mesh")
    assert result.exit_code == 0
    assert ftetwild.calls == [(0.05, None, 600.0)]
    assert "duplicate vertices merged" in result.stderr
    assert "radius ratio 0." in result.stderr and "(+2.50% against the surface)" in result.stderr
    scene, header = read_scene(experiment.run / "scene.h5")
    assert scene.mesh.n_cells == beam(resolution=2).n_cells
    assert header.notes["surface_volume_change"] == pytest.approx(0.025, rel=1e-6)
    assert header.notes["surface_volume"] == pytest.approx(scene.points.weights.sum())
    assert "duplicate vertices merged" in str(header.notes["surface_repairs"])


@pytest.mark.parametrize(
    "change",
    [{"density": 900.0}, {"pins": [{"slab": {"axis": "x", "at": "max", "thickness": 0.01}}]}],
    ids=["density", "pins"],
)
def test_what_does_not_shape_the_tets_keeps_them(
    experiment: Experiment, ftetwild: FTetWild, change: dict[str, Any]
) -> None:
    configure(experiment)
    assert experiment.invoke("mesh").exit_code == 0
    first, header = read_scene(experiment.run / "scene.h5")
    configure(experiment, **change)
    result = experiment.invoke("mesh")
    assert "are kept" in result.stderr and len(ftetwild.calls) == 1
    second, again = read_scene(experiment.run / "scene.h5")
    assert np.array_equal(first.mesh.vertices, second.mesh.vertices)
    assert np.array_equal(first.mesh.cells, second.mesh.cells)
    kept = {name for name in header.notes if name.startswith("surface_")}
    assert all(again.notes[name] == header.notes[name] for name in kept) and len(kept) == 7


@pytest.mark.parametrize(
    "change",
    [
        {"scale": 0.002},
        {"refine": 1},
        {"surface": {"file": "beam.off", "edge_length": 0.06}},
        {"surface": {"file": "beam.off", "cells": 100}},
    ],
    ids=["scale", "refine", "edge length", "cells"],
)
def test_what_shapes_the_tets_makes_them_anew(
    experiment: Experiment, ftetwild: FTetWild, change: dict[str, Any]
) -> None:
    configure(experiment)
    experiment.invoke("mesh")
    configure(experiment, **change)
    assert experiment.invoke("mesh").exit_code == 0
    assert len(ftetwild.calls) == 2
    cells = read_scene(experiment.run / "scene.h5")[0].mesh.n_cells
    assert cells == beam(resolution=2).n_cells * (8 if "refine" in change else 1)


def test_another_surface_in_the_same_file_is_filled_anew(experiment: Experiment, ftetwild: FTetWild) -> None:
    configure(experiment)
    experiment.invoke("mesh")
    write(experiment.folder / "beam.off", surface_of("pendulum"))
    assert experiment.invoke("mesh").exit_code == 0
    assert len(ftetwild.calls) == 2


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda made: {"radius_ratio_min": 0.01}, "nearly flat"),
        (lambda made: {"volume_change": -0.06}, "the volume differs"),
    ],
    ids=["flat", "volume"],
)
def test_poor_tets_are_warned_of(
    experiment: Experiment,
    ftetwild: FTetWild,
    monkeypatch: pytest.MonkeyPatch,
    spoil: Callable[[Tetrahedralization], dict[str, float]],
    words: str,
) -> None:
    good = Tetrahedralization.quality
    monkeypatch.setattr(Tetrahedralization, "quality", lambda self: good(self) | spoil(self))
    configure(experiment)
    assert words in experiment.invoke("mesh").stderr
