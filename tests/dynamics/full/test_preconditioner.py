"""The turned, factorised Hessian with its grabs against a dense matrix."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.dynamics.full.preconditioner import WarpedHessian, grab_rows
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.mesh.shapes import beam
from tests.helpers import bent, random_rotation, scene

Array = NDArray[np.float64]
GRABS = {
    "no grab": [],
    "one grab": [Grab(np.array([20, 21, 30]), np.zeros(3), 50.0)],
    "two grabs that share a vertex": [
        Grab(np.array([20, 21]), np.zeros(3), 50.0),
        Grab(np.array([21, 35]), np.ones(3), 1e4),
    ],
}


@pytest.fixture(params=["tet4", "hex8"])
def body(request: pytest.FixtureRequest) -> Scene:
    return scene(beam(0.4, 0.1, 0.1, 2, request.param), "stable_neo_hookean", youngs_modulus=1e4)


def dense_solve(body: Scene, u: Array, grabs: list[Grab], right: Array) -> Array:
    """(M/h² + K(u) + Σ k AᵀA)⁻¹ right on the free vertices, by dense matrices."""
    n = body.mesh.n_vertices
    pattern = StiffnessPattern(body.points.nodes, np.arange(n), n)
    H = pattern.matrix(pattern.stiffness_blocks(body.elements, u, clamp=True)).toarray()
    H += np.kron(body.mass.toarray(), np.eye(3)) / body.time_step**2
    for grab in grabs:
        average = np.zeros((3, n, 3))
        for axis in range(3):
            average[axis, grab.vertices, axis] = 1 / len(grab.vertices)
        A = average.reshape(3, 3 * n)
        H += grab.stiffness * A.T @ A
    free = (3 * body.free[:, None] + np.arange(3)).ravel()
    x = np.zeros(3 * n)
    x[free] = np.linalg.solve(H[np.ix_(free, free)], right[free])
    return x


@pytest.mark.parametrize("grabs", GRABS.values(), ids=GRABS.keys())
def test_at_the_state_of_the_factor_it_is_the_dense_inverse(body: Scene, grabs: list[Grab]) -> None:
    u, right = bent(body.mesh), np.random.default_rng(0).normal(size=3 * body.mesh.n_vertices)
    hessian = WarpedHessian(body)
    hessian.factorise(u)
    hessian.prepare(u, grabs)
    expected = dense_solve(body, u, grabs, right)
    np.testing.assert_allclose(hessian.solve(right), expected, atol=1e-11 * np.abs(expected).max())
    assert not hessian.solve(right).reshape(-1, 3)[body.pinned].any()


@pytest.mark.parametrize("grabs", GRABS.values(), ids=GRABS.keys())
def test_it_stays_exact_when_the_whole_solid_has_turned(body: Scene, grabs: list[Grab]) -> None:
    u, right = bent(body.mesh), np.random.default_rng(1).normal(size=3 * body.mesh.n_vertices)
    Q = random_rotation(np.random.default_rng(2))
    turned = (body.mesh.vertices + u) @ Q.T - body.mesh.vertices
    hessian = WarpedHessian(body)
    hessian.factorise(u)
    hessian.prepare(turned, grabs)
    expected = dense_solve(body, turned, grabs, right)
    np.testing.assert_allclose(hessian.solve(right), expected, atol=1e-9 * np.abs(expected).max())
    hessian.prepare(u, grabs)
    assert np.abs(hessian.solve(right) - expected).max() > 0.01 * np.abs(expected).max()


def test_preparing_anew_forgets_the_grabs_before(body: Scene) -> None:
    u, right = bent(body.mesh), np.ones(3 * body.mesh.n_vertices)
    hessian = WarpedHessian(body)
    hessian.factorise(u)
    hessian.prepare(u, GRABS["one grab"])
    held = hessian.solve(right)
    hessian.prepare(u, [])
    np.testing.assert_array_equal(hessian.solve(right), hessian.solve_without_grabs(right))
    assert np.abs(hessian.solve(right) - held).max() > 1e-3 * np.abs(held).max()


def test_grab_rows_give_the_centroids_displacement_times_the_root_of_the_stiffness() -> None:
    u = np.random.default_rng(3).normal(size=(40, 3))
    rows = grab_rows(GRABS["two grabs that share a vertex"], 40)
    expected = [np.sqrt(50.0) * u[[20, 21]].mean(axis=0), np.sqrt(1e4) * u[[21, 35]].mean(axis=0)]
    np.testing.assert_allclose(rows @ u.ravel(), np.concatenate(expected), rtol=1e-13)
