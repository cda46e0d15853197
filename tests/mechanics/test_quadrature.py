"""Quadrature points and mass: exact volumes, linear fields, closed-form integrals."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mechanics.quadrature import mass_matrix, quadrature, reference_points
from ldsim.mesh.mesh import Mesh, check_cells
from ldsim.mesh.shapes import CUBE_CORNERS, beam, cross
from tests.helpers import jittered

CELL_TYPES = ["tet4", "hex8"]
SIDES = np.array([0.4, 0.2, 0.3])  # of the box below: [0, 0.4] × [−0.1, 0.1] × [−0.15, 0.15]
DENSITY = 700.0


@pytest.fixture(params=CELL_TYPES)
def cell_type(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def box(cell_type: str) -> Mesh:
    return beam(0.4, 0.3, 0.2, resolution=3, cell_type=cell_type)


def test_shape_functions_sum_to_one_and_their_gradients_to_zero(cell_type: str) -> None:
    shape, gradients, weights = reference_points(cell_type)
    np.testing.assert_allclose(shape.sum(axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(gradients.sum(axis=1), 0, atol=1e-14)
    assert weights.sum() == pytest.approx(1 / 6 if cell_type == "tet4" else 8)


def test_weights_sum_to_the_volume_also_of_distorted_cells(box: Mesh) -> None:
    distorted = jittered(box, 0.02)
    assert not np.array_equal(distorted.vertices, box.vertices)
    points = quadrature(distorted)
    assert points.weights.sum() == pytest.approx(SIDES.prod(), rel=1e-12)
    assert points.weights.min() > 0
    assert points.n_points == box.n_cells * (1 if box.cell_type == "tet4" else 8)


def test_gradients_reproduce_every_linear_field_on_distorted_cells(cell_type: str) -> None:
    mesh = jittered(beam(resolution=3, cell_type=cell_type), 0.01)
    points = quadrature(mesh)
    A = np.random.default_rng(0).normal(size=(3, 3))
    field = mesh.vertices @ A.T + [1, 2, 3]
    slopes = np.einsum("sai,saj->sij", field[points.nodes], points.gradients)
    np.testing.assert_allclose(slopes, np.broadcast_to(A, slopes.shape), atol=1e-11)


def test_the_points_of_a_cell_come_in_sequence_with_its_nodes(box: Mesh) -> None:
    points = quadrature(box)
    np.testing.assert_array_equal(points.nodes, box.cells[points.cells])
    assert (np.diff(points.cells) >= 0).all()


def test_mass_sums_to_density_times_volume_cell_by_cell() -> None:
    for cell_type in CELL_TYPES:
        mesh = cross(resolution=2, cell_type=cell_type)
        points = quadrature(mesh)
        density = np.random.default_rng(1).uniform(100, 1000, mesh.n_cells)
        mass = mass_matrix(mesh, points, density)
        assert mass.sum() == pytest.approx(float(density[points.cells] @ points.weights), rel=1e-12)
        assert abs(mass - mass.T).max() < 1e-15
        assert np.linalg.eigvalsh(mass.toarray()).min() > 0


def test_mass_rows_sum_to_the_mass_around_each_vertex() -> None:
    mesh = jittered(beam(resolution=3), 0.01)
    points = quadrature(mesh)
    around = np.zeros(mesh.n_vertices)
    np.add.at(around, mesh.cells, DENSITY * points.weights[:, None] / 4)
    rows = mass_matrix(mesh, points, np.full(mesh.n_cells, DENSITY)).sum(axis=1)
    np.testing.assert_allclose(rows, around, rtol=1e-12)


def test_consistent_mass_integrates_products_of_linear_fields_exactly(box: Mesh) -> None:
    mass = mass_matrix(box, quadrature(box), np.full(box.n_cells, DENSITY))
    x = box.vertices - [0.2, 0, 0]
    total = DENSITY * SIDES.prod()
    np.testing.assert_allclose(x.T @ (mass @ x), np.diag(total * SIDES**2 / 12), atol=1e-13)
    np.testing.assert_allclose(mass.sum(axis=0) @ box.vertices, total * np.array([0.2, 0, 0]), atol=1e-13)


# Found by a random search: at every corner it is right-handed, but not at a quadrature point near the first.
FOLDED = np.array(
    [
        *([0.0, 0.7, 0.9], [1.0, -0.5, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]),
        *([0.3, 0.0, -0.2], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [-0.9, 1.0, 1.0]),
    ]
)


def test_a_hexahedron_that_is_folded_between_its_corners_is_refused() -> None:
    mesh = Mesh(np.vstack([CUBE_CORNERS, FOLDED + [3, 0, 0]]), np.arange(16).reshape(2, 8), "hex8")
    check_cells(mesh)
    with pytest.raises(MeshError, match="cell 1 is folded between its corners"):
        quadrature(mesh)
