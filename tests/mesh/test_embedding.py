"""Points bound to a mesh: affine motions move them exactly, inside and outside; what lies far away is refused."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mesh.embedding import embedding
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import beam
from tests.helpers import random_rotation


def bricks() -> Mesh:
    """Two hexahedra that are no cuboids."""
    x = np.array([[i, j, k] for i in range(3) for j in (0, 1) for k in (0, 1)], dtype=float)
    x += 0.04 * np.random.default_rng(0).normal(size=x.shape)
    hexes = [[0, 4, 6, 2, 1, 5, 7, 3], [4, 8, 10, 6, 5, 9, 11, 7]]
    return Mesh(x, np.array(hexes, dtype=np.int32), "hex8")


@pytest.mark.parametrize("mesh", [beam(resolution=2), bricks()], ids=["tets", "hexahedra"])
def test_rigid_and_affine_motions_move_points_exactly_inside_and_outside(mesh: Mesh) -> None:
    rng = np.random.default_rng(1)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = low + (1.1 * rng.random((500, 3)) - 0.05) * (high - low)
    P = embedding(mesh, points)
    size = mesh.diagonal
    np.testing.assert_allclose(P @ mesh.vertices, points, atol=1e-12 * size)
    for A in (random_rotation(rng), np.eye(3) + rng.normal(size=(3, 3))):
        b = rng.normal(size=3)
        np.testing.assert_allclose(P @ (mesh.vertices @ A.T + b), points @ A.T + b, atol=1e-11 * size)


def test_a_point_inside_is_carried_by_the_cell_around_it() -> None:
    mesh = beam(resolution=2)
    rng = np.random.default_rng(2)
    cells = rng.integers(mesh.n_cells, size=300)
    share = rng.dirichlet(np.ones(4), size=300)
    P = embedding(mesh, np.einsum("pi,pix->px", share, mesh.vertices[mesh.cells[cells]]))
    for row, (cell, own) in enumerate(zip(cells, share, strict=True)):
        expected = np.zeros(mesh.n_vertices)
        expected[mesh.cells[cell]] = own
        np.testing.assert_allclose(P[[row]].toarray()[0], expected, atol=1e-9)


def test_a_surface_of_another_size_is_refused() -> None:
    mesh = beam(resolution=1)
    with pytest.raises(MeshError, match=r"point 1 of the surface lies .* m outside of the mesh"):
        embedding(mesh, np.stack([mesh.vertices[0], 1000 * mesh.vertices.max(axis=0)]))
