"""Elastic energy, forces and stiffness of whole meshes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.mechanics.elastic import (
    PAIRS,
    add_elastic_gradient,
    deformation_gradient,
    elastic_energy,
    point_stresses,
    smallest_volume_ratio,
    third_derivative,
    vertex_rotations,
)
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern, vertex_graph
from ldsim.mesh.shapes import beam
from tests.helpers import bent, derivative_order, jittered, random_rotation, scene

Array = NDArray[np.float64]
CASES = [(name, kind) for name in MATERIALS for kind in ("tet4", "hex8")]


def solid(material: str, cell_type: str) -> Scene:
    return scene(jittered(beam(0.3, 0.1, 0.1, 2, cell_type), 0.01), material, youngs_modulus=1.0, poisson_ratio=0.3)


@pytest.fixture(params=CASES, ids=" ".join)
def body(request: pytest.FixtureRequest) -> Scene:
    return solid(*request.param)


@pytest.fixture(params=[case for case in CASES if case[0] != "linear"], ids=" ".join)
def rotatable(request: pytest.FixtureRequest) -> Scene:
    return solid(*request.param)


def gradient(body: Scene, u: Array) -> Array:
    g = np.zeros_like(u)
    add_elastic_gradient(body.elements, u, g)
    return g


def stiffness(body: Scene, u: Array, clamp: bool = False) -> Array:
    """K(u) over all vertices, (3n, 3n) dense."""
    n = body.mesh.n_vertices
    pattern = StiffnessPattern(body.points.nodes, np.arange(n), n)
    dense: Array = pattern.matrix(pattern.stiffness_blocks(body.elements, u, clamp)).toarray()
    return dense


def rigid(body: Scene, seed: int = 3) -> Array:
    Q = random_rotation(np.random.default_rng(seed))
    return body.mesh.vertices @ (Q - np.eye(3)).T + [0.1, -0.2, 0.3]


def test_the_bent_state_is_far_from_rest_and_nowhere_inverted(body: Scene) -> None:
    u = bent(body.mesh)
    F = np.array([deformation_gradient(*body.elements[:2], s, u) for s in range(body.points.n_points)])
    assert np.abs(F - np.eye(3).ravel()).max() > 0.3
    assert smallest_volume_ratio(body.elements, u)[1] > 0


def test_the_gradient_is_the_derivative_of_the_energy(body: Scene) -> None:
    u, d = bent(body.mesh), np.random.default_rng(1).normal(size=body.mesh.vertices.shape)
    order = derivative_order(
        lambda x: elastic_energy(body.elements, x), lambda x: np.vdot(gradient(body, x), d), u, d, size=0.05
    )
    assert order == pytest.approx(2, abs=0.1)


def test_the_gradient_kernel_returns_the_energy_and_adds_to_what_is_there(body: Scene) -> None:
    u = bent(body.mesh)
    g = np.ones_like(u)
    value = add_elastic_gradient(body.elements, u, g)
    assert value == pytest.approx(elastic_energy(body.elements, u), rel=1e-13)
    np.testing.assert_allclose(g - 1, gradient(body, u), atol=1e-14)


def test_the_stiffness_is_the_derivative_of_the_gradient(body: Scene) -> None:
    u, d = bent(body.mesh), np.random.default_rng(2).normal(size=body.mesh.vertices.shape)
    order = derivative_order(
        lambda x: gradient(body, x).ravel(), lambda x: stiffness(body, x) @ d.ravel(), u, d, size=0.01
    )
    assert order == np.inf or order == pytest.approx(2, abs=0.15)


def test_the_stiffness_is_symmetric_and_positive_semidefinite_once_clamped(body: Scene) -> None:
    u = bent(body.mesh) - 0.5 * body.mesh.vertices
    K = stiffness(body, u, clamp=True)
    np.testing.assert_allclose(K, K.T, atol=1e-12 * np.abs(K).max())
    assert np.linalg.eigvalsh(K).min() > -1e-11 * np.abs(K).max()


def test_the_third_derivative_at_rest_is_the_second_difference_of_the_gradient(body: Scene) -> None:
    fields = np.random.default_rng(7).normal(size=(body.mesh.n_vertices, 3, 3))
    found = third_derivative(body.elements, fields)

    def bent(field: Array) -> Array:
        h = 1e-4 / np.abs(field).max()
        return np.asarray(gradient(body, h * field) - 2 * gradient(body, 0 * field) + gradient(body, -h * field)) / h**2

    scale = np.abs(found).max()
    for pair, (i, j) in enumerate(PAIRS):
        a, b = fields[:, :, i], fields[:, :, j]
        expected = bent(a) if i == j else 0.5 * (bent(a + b) - bent(a) - bent(b))
        np.testing.assert_allclose(found[:, :, pair], expected, atol=1e-4 * scale + 1e-7)


def test_elastic_forces_have_no_resultant(body: Scene) -> None:
    g = gradient(body, bent(body.mesh))
    np.testing.assert_allclose(g.sum(axis=0), 0, atol=1e-13 * np.abs(g).sum())


def test_elastic_forces_have_no_torque_about_the_deformed_solid(rotatable: Scene) -> None:
    u = bent(rotatable.mesh)
    torques = np.cross(rotatable.mesh.vertices + u, gradient(rotatable, u))
    np.testing.assert_allclose(torques.sum(axis=0), 0, atol=1e-13 * np.abs(torques).sum())


def test_a_rigid_motion_costs_nothing(rotatable: Scene) -> None:
    u = rigid(rotatable)
    assert abs(elastic_energy(rotatable.elements, u)) < 1e-14 * rotatable.points.weights.sum()
    assert np.abs(gradient(rotatable, u)).max() < 1e-14


def test_rigid_motions_span_the_null_space_of_the_rest_stiffness(body: Scene) -> None:
    x = body.mesh.vertices
    turns = [np.cross(axis, x).ravel() for axis in np.eye(3)]
    shifts = [np.broadcast_to(axis, x.shape).ravel() for axis in np.eye(3)]
    K = stiffness(body, np.zeros_like(x))
    np.testing.assert_allclose(K @ np.array(turns + shifts).T, 0, atol=1e-13 * np.abs(K).max())
    values = np.linalg.eigvalsh(K)
    assert values[6] > 1e-4 * values[-1] > abs(values[5]) * 1e6


def test_a_homogeneous_deformation_leaves_the_inside_free_of_force(body: Scene) -> None:
    x = body.mesh.vertices
    F = np.array([[1.2, 0.1, 0.0], [-0.1, 0.9, 0.2], [0.05, 0.0, 1.1]])
    u = x @ (F - np.eye(3)).T
    stresses = np.empty((body.points.n_points, 9))
    point_stresses(body.elements, u, stresses)
    assert np.abs(stresses[0]).max() > 0.01
    np.testing.assert_allclose(stresses, np.broadcast_to(stresses[0], stresses.shape), atol=1e-12)
    inside = ((x > x.min(axis=0) + 1e-9) & (x < x.max(axis=0) - 1e-9)).all(axis=1)
    assert inside.any()
    g = gradient(body, u)
    assert np.abs(g[inside]).max() < 1e-13 < 1e-3 * np.abs(g[~inside]).max()


def test_forces_are_the_divergence_of_the_point_stresses(body: Scene) -> None:
    u, points = bent(body.mesh), body.points
    stresses = np.empty((points.n_points, 9))
    point_stresses(body.elements, u, stresses)
    forces = np.einsum("s,sij,saj->sai", points.weights, stresses.reshape(-1, 3, 3), points.gradients)
    total = np.zeros_like(u)
    np.add.at(total, points.nodes, forces)
    np.testing.assert_allclose(gradient(body, u), total, atol=1e-14)


def test_a_state_with_an_inverted_cell_has_infinite_energy_if_the_material_forbids_it() -> None:
    for name in ("neo_hookean", "stable_neo_hookean"):
        body = solid(name, "tet4")
        u = -2.0 * body.mesh.vertices * [1, 0, 0]
        assert smallest_volume_ratio(body.elements, u)[1] == pytest.approx(-1.0)
        expected = name == "neo_hookean"
        assert np.isinf(elastic_energy(body.elements, u)) == expected
        assert np.isinf(add_elastic_gradient(body.elements, u, np.zeros_like(u))) == expected


def test_the_smallest_volume_ratio_is_that_of_the_most_crushed_point_and_what_is_not_finite_is_worse() -> None:
    body = solid("neo_hookean", "tet4")
    u = bent(body.mesh)
    F = np.array([deformation_gradient(*body.elements[:2], s, u) for s in range(body.points.n_points)])
    J = np.linalg.det(F.reshape(-1, 3, 3))
    point, smallest = smallest_volume_ratio(body.elements, u)
    assert (point, smallest) == (J.argmin(), pytest.approx(J.min(), rel=1e-12))
    u[body.mesh.cells[5, 0]] = np.nan
    point, smallest = smallest_volume_ratio(body.elements, u)
    assert np.isnan(smallest) and body.mesh.cells[5, 0] in body.points.nodes[point]


def test_vertex_rotations_follow_a_rigid_motion(body: Scene) -> None:
    rotations = np.empty((body.mesh.n_vertices, 3, 3))
    vertex_rotations(body.elements, rigid(body, seed=5), rotations)
    Q = random_rotation(np.random.default_rng(5))
    np.testing.assert_allclose(rotations, np.broadcast_to(Q, rotations.shape), atol=1e-12)


def test_a_pattern_of_some_vertices_in_some_order_is_the_submatrix_in_that_order() -> None:
    body = solid("stable_neo_hookean", "tet4")
    u = bent(body.mesh)
    order = np.random.default_rng(4).permutation(body.free)
    pattern = StiffnessPattern(body.points.nodes, order, body.mesh.n_vertices)
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    part = pattern.matrix(pattern.stiffness_blocks(body.elements, u, clamp=False)).toarray()
    np.testing.assert_allclose(part, stiffness(body, u)[np.ix_(dofs, dofs)], atol=1e-13)
    scalar = np.zeros((pattern.n_free, pattern.n_free))
    scalar[pattern.rows, pattern.columns] = pattern.blocks_of(body.mass)
    np.testing.assert_allclose(scalar, body.mass.toarray()[np.ix_(order, order)], atol=1e-16)


def test_the_vertex_graph_joins_free_vertices_that_share_a_cell_and_no_vertex_with_itself() -> None:
    body = solid("linear", "hex8")
    graph = vertex_graph(body.points.nodes, body.free, body.mesh.n_vertices).toarray()
    expected = body.mass.toarray()[np.ix_(body.free, body.free)] > 0
    np.fill_diagonal(expected, False)
    np.testing.assert_array_equal(graph > 0, expected)
