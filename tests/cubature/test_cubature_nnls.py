"""Non-negative least squares against scipy's, and the price of leaving a variable out against solving again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from ldsim.cubature.nnls import losses_without, solve_on_support


def unit_columns(seed: int, rows: int = 40, columns: int = 12, mean: float = 0.8) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((rows, columns)) + mean
    return A / np.linalg.norm(A, axis=0), rng.standard_normal(rows) + 0.3


@pytest.mark.parametrize("seed", range(5))
def test_adding_the_steepest_variable_until_none_is_left_ends_at_scipys_solution(seed: int) -> None:
    A, b = unit_columns(seed)
    x = np.zeros(A.shape[1])
    for _ in range(100):
        gradient = np.where(x > 0, -np.inf, A.T @ (b - A @ x))
        if gradient.max() <= 1e-12:
            break
        support = x > 0
        support[gradient.argmax()] = True
        x = solve_on_support(A.T @ A, A.T @ b, x, support)
    expected = nnls(A, b)[0]
    assert 0 < (expected > 0).sum() < len(expected)
    assert np.allclose(x, expected, atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_from_any_start_the_objective_never_rises_and_the_rest_is_solved(seed: int) -> None:
    A, b = unit_columns(seed, rows=14, mean=3.0)
    b += 1.0
    start = nnls(A, b + 0.5 * np.random.default_rng(seed).standard_normal(len(b)))[0] + 1e-3
    x = solve_on_support(A.T @ A, A.T @ b, start, start > 0)
    left = x > 0
    assert (x >= 0).all()
    assert 0 < left.sum() < len(x)
    assert np.allclose((A.T @ (b - A @ x))[left], 0.0, atol=1e-9)
    assert np.linalg.norm(b - A @ x) <= np.linalg.norm(b - A @ start)


def test_equal_columns_share_their_weight() -> None:
    A, _ = unit_columns(0, columns=3)
    A = A[:, [0, 1, 1]]
    b = A @ np.array([1.0, 1.0, 1.0])
    x = solve_on_support(A.T @ A, A.T @ b, np.zeros(3), np.ones(3, dtype=bool))
    assert np.allclose(x, 1.0, atol=1e-6)


def test_the_loss_of_a_variable_is_what_the_residual_grows_by_without_it() -> None:
    A, _ = unit_columns(1)
    x = np.zeros(A.shape[1])
    x[[1, 4, 6]] = [2.0, 3.0, 1.0]
    losses = losses_without(A.T @ A, x)
    b = A @ x
    for j, others in ((1, [4, 6]), (4, [1, 6]), (6, [1, 4])):
        residual = np.linalg.lstsq(A[:, others], b, rcond=None)[1][0]
        assert losses[j] == pytest.approx(residual, rel=1e-8)
    assert np.isinf(np.delete(losses, [1, 4, 6])).all()
