"""Regions hold what they say and nothing else, and pins refuse what is no support."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from ldsim.errors import SceneError
from ldsim.mechanics.pins import pinned_vertices
from ldsim.mechanics.regions import Ball, Box, Region, Slab
from ldsim.mesh.mesh import Group, Mesh
from ldsim.mesh.shapes import voxel_mesh

# A row of ten cubes of edge 0.1 along x: vertices at x = 0, 0.1, … 1, four each; cell i is centred at 0.05 + i/10.
ROW = voxel_mesh(np.ones((10, 1, 1), dtype=bool), 0.1, "hex8")
ENDS = np.flatnonzero((ROW.vertices[:, 0] < 0.01) | (ROW.vertices[:, 0] > 0.99))
GROUPED = Mesh(ROW.vertices, ROW.cells, "hex8", {"ends": Group(ENDS, np.array([0, 9])), "faces": Group(ENDS, ENDS[:0])})

REGIONS: dict[str, tuple[Region, list[int], list[int]]] = {
    "slab at the smallest": (Region(slab=Slab(axis="x", at="min", thickness=0.15)), [0, 1], [0, 1]),
    "slab at the largest": (Region(slab=Slab(axis="x", at="max", thickness=0.14)), [9, 10], [9]),
    "ball": (Region(ball=Ball(centre=(0.5, 0.05, 0.05), radius=0.13)), [4, 5, 6], [4, 5]),
    "box": (Region(box=Box(min=(0.19, 0, 0), max=(0.41, 0.1, 0.1))), [2, 3, 4], [2, 3]),
    "list": (Region(vertices=tuple(np.flatnonzero(ROW.vertices[:, 0] < 0.11).tolist())), [0, 1], [0]),
    "group": (Region(group="ends"), [0, 10], [0, 9]),
}


@pytest.mark.parametrize(("region", "vertices", "cells"), REGIONS.values(), ids=REGIONS)
def test_a_region_holds_its_vertices_and_cells(region: Region, vertices: list[int], cells: list[int]) -> None:
    held = region.vertex_mask(GROUPED)
    assert np.unique(np.rint(10 * GROUPED.vertices[held, 0])).tolist() == vertices
    assert held.sum() == 4 * len(vertices)
    centroids = GROUPED.vertices[GROUPED.cells[region.cell_mask(GROUPED)]].mean(axis=1)
    assert sorted(np.floor(10 * centroids[:, 0]).tolist()) == cells


@pytest.mark.parametrize("at", ["min", "max"])
def test_a_slab_holds_the_layer_at_its_bound_whatever_rounding_makes_of_that(at: Literal["min", "max"]) -> None:
    for length in range(2, 11):
        row = voxel_mesh(np.ones((length, 1, 1), dtype=bool), 0.1, "hex8")
        for layers in range(1, length):
            slab = Region(slab=Slab(axis="x", at=at, thickness=layers / 10))
            assert slab.vertex_mask(row).sum() == 4 * (layers + 1), (length, layers)


def test_a_box_in_metres_holds_what_lies_on_its_bound_in_millimetres() -> None:
    """18 times 0.001 is 0.018000000000000002."""
    metres = Mesh(ROW.vertices / 0.1 * [18, 1, 1] * 0.001, ROW.cells, "hex8")
    for layer in range(1, 10):
        low, high = Box(min=(-1, -1, -1), max=(0.018 * layer, 1, 1)), Box(min=(0.018 * layer, -1, -1), max=(1, 1, 1))
        assert Region(box=low).vertex_mask(metres).sum() == 4 * (layer + 1)
        assert Region(box=high).vertex_mask(metres).sum() == 4 * (11 - layer)


def test_a_ball_holds_what_lies_on_it() -> None:
    corner = ROW.vertices.min(axis=0)
    along = (ROW.vertices[:, 1:] == corner[1:]).all(axis=1)
    for layer in range(1, 10):
        ball = Region(ball=Ball(centre=tuple(corner.tolist()), radius=layer / 10))
        assert ball.vertex_mask(ROW)[along].sum() == layer + 1


def test_pins_add_up() -> None:
    both = pinned_vertices(
        GROUPED, [Region(slab=Slab(axis="x", at="min", thickness=0.05)), Region(vertices=(5,)), Region(group="ends")]
    )
    assert np.flatnonzero(both).tolist() == sorted({5, *ENDS.tolist()})


BAD_PINS: dict[str, tuple[Region, str]] = {
    "far ball": (Region(ball=Ball(centre=(5, 0, 0), radius=0.1)), "pins no vertex; the solid spans"),
    "empty box": (Region(box=Box(min=(0.31, 0, 0), max=(0.39, 1, 1))), "pins no vertex; the solid spans"),
    "everything": (Region(slab=Slab(axis="y", at="min", thickness=1.0)), "hold all 44 vertices"),
    "unknown vertex": (Region(vertices=(3, 44)), "vertex 44 of a list does not exist; the mesh has 0 … 43"),
    "unknown group": (Region(group="end"), "no group 'end'; known are ends, faces"),
}


@pytest.mark.parametrize(("region", "message"), BAD_PINS.values(), ids=BAD_PINS)
def test_pins_that_are_no_support_are_refused(region: Region, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        pinned_vertices(GROUPED, [region])


def test_a_group_of_a_mesh_without_groups_says_that_there_are_none() -> None:
    with pytest.raises(SceneError, match="no group 'end'; known are none: its file defines no groups"):
        pinned_vertices(ROW, [Region(group="end")])


def test_cells_of_a_group_of_faces_are_none_and_refused() -> None:
    with pytest.raises(SceneError, match="'faces'.* changes no cell"):
        Region(group="faces").cells_in(GROUPED, "changes")
