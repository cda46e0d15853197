"""The scalar tensor algebra of the kernels against NumPy, degenerate matrices included."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.mechanics.materials.tensors import (
    clamped_symmetric,
    cofactor,
    determinant,
    inverse_cube_root,
    signed_svd,
    squared_norm,
    symmetric_eigen,
)
from tests.helpers import random_rotation

Array = NDArray[np.float64]
RNG = np.random.default_rng(0)
Q, R = random_rotation(RNG), random_rotation(RNG)

MATRICES = {
    "random": RNG.normal(size=(3, 3)),
    "inverted": Q @ np.diag([1.5, 1.0, -0.4]) @ R,
    "inverted thrice": -Q,
    "identity": np.eye(3),
    "rotation": Q,
    "two equal, larger": Q @ np.diag([2.0, 2.0, 1.0]) @ R,
    "two equal, smaller": Q @ np.diag([2.0, 1.0, 1.0]) @ R,
    "two equal up to sign": Q @ np.diag([2.0, 1.0, -1.0]) @ R,
    "two nearly equal": Q @ np.diag([2.0, 2.0 + 1e-9, 1.0]) @ R,
    "three nearly equal": Q @ np.diag([1.0, 1 + 1e-12, 1 - 1e-12]) @ R,
    "flat": Q @ np.diag([1.0, 0.5, 0.0]) @ R,
    "a line": Q @ np.diag([1.0, 0.0, 0.0]) @ R,
    "a line along x": np.diag([3.0, 0.0, 0.0]),
    "a line along z": np.diag([0.0, 0.0, 3.0]),
    "zero": np.zeros((3, 3)),
    "large": 1e8 * Q @ np.diag([3.0, 2.0, 1.0]) @ R,
    "small": 1e-8 * Q @ np.diag([3.0, 2.0, -1.0]) @ R,
    "permuted": np.array([[0.0, 2, 0], [0, 0, 3], [1, 0, 0]]),
    **{f"diagonal {stretches}": np.diag(stretches) for stretches in permutations((3.0, 2.0, -1.0))},
}


# V comes from FᵀF, which does not see stretches below √ε of the largest: they mix, so F comes back only to their size.
NEARLY_A_LINE = Q @ np.diag([1.0, 1e-9, 1e-12]) @ R


@pytest.fixture(params=MATRICES)
def F(request: pytest.FixtureRequest) -> Array:
    return MATRICES[request.param]


def flat(A: Array) -> tuple[float, ...]:
    return tuple(A.ravel())


def assert_rotation(A: Array) -> None:
    np.testing.assert_allclose(A.T @ A, np.eye(3), atol=1e-13)
    assert np.linalg.det(A) == pytest.approx(1, abs=1e-13)


def test_signed_svd_is_made_of_two_rotations_and_gives_the_matrix_back(F: Array) -> None:
    U, s, V = signed_svd(flat(F))
    assert_rotation(np.reshape(U, (3, 3)))
    assert_rotation(np.reshape(V, (3, 3)))
    rebuilt = np.reshape(U, (3, 3)) @ np.diag(s) @ np.reshape(V, (3, 3)).T
    np.testing.assert_allclose(rebuilt, F, rtol=0, atol=1e-13 * max(np.abs(F).max(), 1e-300))


def test_signed_svd_of_a_matrix_crushed_to_a_line_errs_by_no_more_than_the_small_stretches() -> None:
    U, s, V = signed_svd(flat(NEARLY_A_LINE))
    assert_rotation(np.reshape(U, (3, 3)))
    assert_rotation(np.reshape(V, (3, 3)))
    rebuilt = np.reshape(U, (3, 3)) @ np.diag(s) @ np.reshape(V, (3, 3)).T
    np.testing.assert_allclose(rebuilt, NEARLY_A_LINE, rtol=0, atol=1e-9)


def test_signed_svd_orders_the_stretches_and_puts_the_sign_on_the_last(F: Array) -> None:
    s = np.array(signed_svd(flat(F))[1])
    singular = np.linalg.svd(F, compute_uv=False)
    scale = max(float(singular[0]), 1e-300)
    np.testing.assert_allclose(np.abs(s), singular, rtol=0, atol=1e-13 * scale)
    assert s[0] >= 0 and s[1] >= 0
    if singular[2] > 1e-13 * scale:
        assert np.sign(s[2]) == np.sign(np.linalg.det(F))


def test_determinant_cofactor_and_norm_are_those_of_numpy(F: Array) -> None:
    assert determinant(flat(F)) == pytest.approx(np.linalg.det(F), rel=1e-12, abs=1e-15 * np.abs(F).max() ** 3)
    assert squared_norm(flat(F)) == pytest.approx(np.sum(F * F), rel=1e-14)
    product = np.reshape(cofactor(flat(F)), (3, 3)).T @ F
    np.testing.assert_allclose(product, np.linalg.det(F) * np.eye(3), rtol=0, atol=1e-13 * np.abs(F).max() ** 3)


def symmetric(A: Array) -> tuple[float, ...]:
    return A[0, 0], A[1, 1], A[2, 2], A[0, 1], A[0, 2], A[1, 2]


def full(s: tuple[float, ...]) -> Array:
    return np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]])


def test_symmetric_eigen_diagonalises_by_a_rotation(F: Array) -> None:
    S = F + F.T
    a, b, c, V = symmetric_eigen(symmetric(S))
    V = np.reshape(V, (3, 3))
    assert_rotation(V)
    np.testing.assert_allclose(V @ np.diag([a, b, c]) @ V.T, S, rtol=0, atol=1e-13 * max(np.abs(S).max(), 1e-300))


def test_clamped_symmetric_is_the_nearest_positive_semidefinite_matrix(F: Array) -> None:
    S = F + F.T
    values, vectors = np.linalg.eigh(S)
    nearest = vectors @ np.diag(np.maximum(values, 0)) @ vectors.T
    clamped = full(clamped_symmetric(symmetric(S)))
    np.testing.assert_allclose(clamped, nearest, rtol=0, atol=1e-13 * max(np.abs(S).max(), 1e-300))
    if values.min() > 0:
        np.testing.assert_array_equal(clamped, S)


@pytest.mark.parametrize("exponent", range(-30, 31, 3))
def test_the_inverse_cube_root_is_exact_but_for_rounding(exponent: int) -> None:
    for x in 10.0**exponent * np.random.default_rng(exponent + 30).uniform(1, 1000, 20):
        assert inverse_cube_root(x) == pytest.approx(1 / np.cbrt(x), rel=1e-15)
