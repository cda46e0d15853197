"""The mesh's own checks, its volumes, its components."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mesh.mesh import CORNER_FRAMES, Mesh, check_cells, components, corner_volumes, doubled_vertices, reoriented
from ldsim.mesh.shapes import CUBE_CORNERS, beam, voxel_mesh

UNIT_TET = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TET = np.array([[0, 1, 2, 3]])

BAD_MESHES = {
    "cell type": (UNIT_TET, TET, "tri3", "cell type 'tri3' is not one of tet4, hex8"),
    "flat points": (UNIT_TET[:, :2], TET, "tet4", r"vertices have shape \(4, 2\)"),
    "no vertices": (np.zeros((0, 3)), TET, "tet4", r"vertices have shape \(0, 3\)"),
    "no cells": (UNIT_TET, np.zeros((0, 4)), "tet4", r"cells have shape \(0, 4\)"),
    "tets as hexes": (UNIT_TET, TET, "hex8", r"cells have shape \(1, 4\); expected \(m, 8\)"),
    "infinite": (np.where(UNIT_TET == 1, np.inf, UNIT_TET), TET, "tet4", "vertex 1 has coordinates"),
    "negative index": (UNIT_TET, TET - 1, "tet4", r"cell 0 refers to vertices \[-1, 0, 1, 2\]; allowed are 0 … 3"),
    "index too large": (UNIT_TET, TET + 1, "tet4", "allowed are 0 … 3"),
    "index beyond 32 bits": (UNIT_TET, TET + 2**32, "tet4", r"cell 0 refers to vertices \[4294967296, .*0 … 3"),
    "index below 32 bits": (UNIT_TET, TET - 2**32, "tet4", r"cell 0 refers to vertices \[-4294967296, .*0 … 3"),
    "no whole numbers": (UNIT_TET, TET + 0.5, "tet4", "cells are of type float64; expected whole numbers"),
}


@pytest.mark.parametrize("vertices, cells, cell_type, message", BAD_MESHES.values(), ids=BAD_MESHES.keys())
def test_numbers_that_are_no_mesh_are_refused(
    vertices: np.ndarray, cells: np.ndarray, cell_type: str, message: str
) -> None:
    with pytest.raises(MeshError, match=message):
        Mesh(vertices, cells, cell_type)


@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_each_corner_of_a_unit_cell_has_its_volume(cell_type: str) -> None:
    points = UNIT_TET if cell_type == "tet4" else CUBE_CORNERS
    mesh = Mesh(points, np.arange(len(points))[None], cell_type)
    np.testing.assert_allclose(corner_volumes(mesh), 1 / 6 if cell_type == "tet4" else 1)


def test_a_hex_corner_is_framed_by_the_three_corners_an_edge_away() -> None:
    for corner, *others in CORNER_FRAMES["hex8"]:
        np.testing.assert_array_equal(np.abs(CUBE_CORNERS[others] - CUBE_CORNERS[corner]).sum(axis=1), 1)
    assert sorted(CORNER_FRAMES["hex8"][:, 0]) == list(range(8))


@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_mirrored_cells_are_inverted_and_reorienting_repairs_them(cell_type: str) -> None:
    good = beam(resolution=1, cell_type=cell_type)
    check_cells(good)
    mirrored = Mesh(good.vertices * [-1, 1, 1], good.cells, cell_type)
    with pytest.raises(MeshError, match=f"{good.n_cells} of {good.n_cells} cells are inverted, the first is cell 0"):
        check_cells(mirrored)
    check_cells(reoriented(mirrored))
    np.testing.assert_array_equal(reoriented(good).cells, good.cells)


def test_a_hex_with_one_corner_pushed_through_is_inverted_and_not_repaired_by_flipping() -> None:
    points = CUBE_CORNERS.astype(float)
    points[6] = [-0.5, -0.5, -0.5]
    folded = Mesh(points, np.arange(8)[None], "hex8")
    for mesh in (folded, reoriented(folded)):
        with pytest.raises(MeshError, match="1 of 1 cells are inverted"):
            check_cells(mesh)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_flat_cell_is_degenerate_at_any_scale_and_a_thin_one_is_not(scale: float) -> None:
    for height, refused in ((0.0, True), (1e-14, True), (1e-6, False)):
        mesh = Mesh(scale * UNIT_TET * [1, 1, height], TET, "tet4")
        if refused:
            with pytest.raises(MeshError, match="1 of 1 cells are degenerate"):
                check_cells(mesh)
        else:
            check_cells(mesh)


def test_a_cell_that_repeats_a_vertex_is_degenerate() -> None:
    with pytest.raises(MeshError, match="degenerate, the first is cell 0 with vertices"):
        check_cells(Mesh(UNIT_TET, [[0, 1, 2, 2]], "tet4"))  # type: ignore[arg-type]


def test_pieces_apart_get_different_labels_and_pieces_that_share_a_vertex_the_same() -> None:
    row = np.zeros((5, 1, 1), dtype=bool)
    row[[0, 1, 4]] = True
    mesh = voxel_mesh(row, 1.0)
    right = mesh.vertices[:, 0] > 3
    np.testing.assert_array_equal(components(mesh), right.astype(int))
    corner_touching = np.zeros((2, 2, 2), dtype=bool)
    corner_touching[0, 0, 0] = corner_touching[1, 1, 1] = True
    assert set(components(voxel_mesh(corner_touching, 1.0))) == {0}


def row_of_two(gap: float) -> Mesh:
    """Two unit cubes in a row, each with vertices of its own, so far apart."""
    return Mesh(np.vstack([CUBE_CORNERS, CUBE_CORNERS + [1 + gap, 0, 0]]), np.arange(16).reshape(2, 8), "hex8")


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_vertices_are_doubled_where_parts_touch_and_not_where_there_is_a_gap(scale: float) -> None:
    for gap, doubled in ((0.0, 8), (1e-8, 8), (1e-4, 0)):
        apart = row_of_two(gap)
        assert doubled_vertices(replace(apart, vertices=scale * apart.vertices)) == doubled


def test_vertices_of_one_part_are_not_doubled_and_neither_is_a_crack_within_it() -> None:
    slab = voxel_mesh(np.ones((2, 2, 1), dtype=bool), 1.0, "hex8")
    assert doubled_vertices(slab) == 0
    middle = int(np.bincount(slab.cells.ravel()).argmax())
    cells = slab.cells.copy()
    cells[0][cells[0] == middle] = slab.n_vertices
    cracked = Mesh(np.vstack([slab.vertices, slab.vertices[middle]]), cells, slab.cell_type)
    assert doubled_vertices(cracked) == 0
