"""Uniform refinement: what it must keep and what it must multiply."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mesh.mesh import Group, Mesh, check_cells, corner_volumes
from ldsim.mesh.refine import refined
from ldsim.mesh.shapes import beam, cross
from ldsim.mesh.surface import CELL_FACES, surface_triangles


def random_tets(seed: int, count: int) -> list[Mesh]:
    """Single right-handed tets of any shape, so that each inner diagonal is the shortest for some."""
    points = np.random.default_rng(seed).normal(size=(count, 4, 3))
    left = np.linalg.det(points[:, 1:] - points[:, :1]) < 0
    points[left] = points[left][:, [0, 2, 1, 3]]
    return [Mesh(tet, np.array([[0, 1, 2, 3]]), "tet4") for tet in points]


def test_each_tet_becomes_eight_right_handed_ones_of_equal_volume() -> None:
    shortest = set()
    for tet in random_tets(0, 40):
        children = corner_volumes(refined(tet)).ravel()
        np.testing.assert_allclose(children, corner_volumes(tet)[0, 0] / 8, rtol=1e-9)
        assert len(children) == 8
        middles = (tet.vertices[[0, 0, 0]] + tet.vertices[[1, 2, 3]]) / 2
        opposite = (tet.vertices[[2, 1, 1]] + tet.vertices[[3, 3, 2]]) / 2
        shortest.add(int(np.linalg.norm(middles - opposite, axis=1).argmin()))
    assert shortest == {0, 1, 2}


def test_the_inner_edge_is_the_shortest_diagonal() -> None:
    for tet in random_tets(1, 20):
        fine = refined(tet)
        ends = fine.cells[4:][:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2)
        edges = Counter(map(tuple, np.sort(ends, axis=1).tolist()))
        inner = [edge for edge, count in edges.items() if count == 4]
        middles = (tet.vertices[[0, 0, 0]] + tet.vertices[[1, 2, 3]]) / 2
        opposite = (tet.vertices[[2, 1, 1]] + tet.vertices[[3, 3, 2]]) / 2
        assert len(inner) == 1
        length = np.linalg.norm(np.diff(fine.vertices[list(inner[0])], axis=0))
        assert length == pytest.approx(np.linalg.norm(middles - opposite, axis=1).min(), rel=1e-12)


@pytest.mark.parametrize("mesh", [beam(resolution=1), cross(resolution=1)], ids=["beam", "cross"])
def test_refinement_conforms_and_keeps_volume_and_outline(mesh: Mesh) -> None:
    fine = refined(refined(mesh))
    check_cells(fine)
    assert fine.n_cells == 64 * mesh.n_cells
    assert len(surface_triangles(fine)) == 16 * len(surface_triangles(mesh))
    assert corner_volumes(fine).sum() == pytest.approx(corner_volumes(mesh).sum(), rel=1e-12)
    np.testing.assert_array_equal(fine.vertices[: mesh.n_vertices], mesh.vertices)
    assert len(np.unique(fine.vertices, axis=0)) == fine.n_vertices
    faces = np.sort(fine.cells[:, CELL_FACES["tet4"]].reshape(-1, 3), axis=1)
    assert set(Counter(map(tuple, faces.tolist())).values()) == {1, 2}


def test_hexes_are_refused() -> None:
    with pytest.raises(MeshError, match="cells are hex8; only tet4"):
        refined(beam(cell_type="hex8"))


def test_a_group_keeps_its_place_when_the_mesh_is_refined() -> None:
    coarse = beam(0.4, 0.1, 0.1, resolution=1)
    end = np.flatnonzero(coarse.vertices[:, 0] == 0)
    left = np.flatnonzero(coarse.vertices[coarse.cells].mean(axis=1)[:, 0] < 0.2)
    groups = {"end": Group(end, left[:0]), "left": Group(np.unique(coarse.cells[left]), left)}
    fine = refined(Mesh(coarse.vertices, coarse.cells, "tet4", groups))
    assert set(fine.groups["end"].vertices) == set(np.flatnonzero(fine.vertices[:, 0] == 0))
    half = np.flatnonzero(fine.vertices[fine.cells].mean(axis=1)[:, 0] < 0.2)
    np.testing.assert_array_equal(fine.groups["left"].cells, half)
    np.testing.assert_array_equal(fine.groups["left"].vertices, np.unique(fine.cells[half]))
