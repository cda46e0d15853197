"""L-BFGS: problems with known minima, the two-loop recursion against dense BFGS, and every reason to stop."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.optimise.minimiser import Memory, Objective, minimise
from ldsim.optimise.solution import Reason

Array = NDArray[np.float64]


def identity(x: Array) -> Array:
    return x.copy()


def spd(size: int, condition: float, seed: int = 0) -> Array:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(size, size)))
    return (q * np.geomspace(1, condition, size)) @ q.T


def quadratic(A: Array, b: Array) -> Objective:
    """½ xᵀA x − bᵀx."""

    def objective(x: Array, gradient: Array) -> float:
        gradient[:] = A @ x - b
        return float(0.5 * x @ A @ x - b @ x)

    return objective


def rosenbrock(x: Array, gradient: Array) -> float:
    gap = x[1] - x[0] ** 2
    gradient[:] = [-400 * x[0] * gap - 2 * (1 - x[0]), 200 * gap]
    return float(100 * gap**2 + (1 - x[0]) ** 2)


def barrier(x: Array, gradient: Array) -> float:
    """Σ x − log x, least at 1 and infinite at x ≤ 0."""
    if x.min() <= 0:
        return math.inf
    gradient[:] = 1 - 1 / x
    return float(np.sum(x - np.log(x)))


def climbing(x: Array, gradient: Array) -> float:
    """½ ‖x‖² with the sign of the gradient wrong."""
    gradient[:] = -x
    return float(0.5 * x @ x)


def test_a_quadratic_with_its_inverse_hessian_takes_one_iteration() -> None:
    A, b, x = spd(20, 1e4), np.ones(20), np.full(20, 3.0)
    solution = minimise(quadratic(A, b), x, lambda r: np.linalg.solve(A, r), 1e-10)
    assert solution.reason == Reason.CONVERGED and solution.converged
    assert (solution.iterations, solution.evaluations) == (1, 2)
    np.testing.assert_allclose(x, np.linalg.solve(A, b), atol=1e-9)


def test_the_record_states_value_and_gradient_at_the_result() -> None:
    A, b, x = spd(8, 10), np.arange(8.0), np.zeros(8)
    solution = minimise(quadratic(A, b), x, identity, 1e-6)
    gradient = np.empty(8)
    assert solution.value == quadratic(A, b)(x, gradient)
    assert solution.gradient_norm == pytest.approx(np.linalg.norm(gradient), rel=1e-12)
    assert solution.gradient_norm <= 1e-6 * max(np.linalg.norm(x), 1)


def test_a_better_preconditioner_takes_fewer_iterations() -> None:
    A, b = spd(40, 100), np.ones(40)
    near = spd(40, 1.5, seed=1) @ np.linalg.inv(A) @ spd(40, 1.5, seed=1)
    plain = minimise(quadratic(A, b), np.zeros(40), lambda r: r / 100, 1e-8)
    helped = minimise(quadratic(A, b), np.zeros(40), lambda r: near @ r, 1e-8)
    assert plain.converged and helped.converged
    assert helped.iterations < plain.iterations / 2


@pytest.mark.parametrize("start", [(-1.2, 1.0), (0.0, 0.0), (3.0, -4.0), (1.0, 1.0)])
def test_rosenbrocks_valley_is_followed_to_its_minimum(start: tuple[float, float]) -> None:
    x = np.array(start)
    solution = minimise(rosenbrock, x, identity, 1e-9)
    assert solution.converged
    np.testing.assert_allclose(x, 1, atol=1e-7)
    assert solution.iterations < 100


def test_infinite_values_are_backed_away_from() -> None:
    x = np.array([5.0, 0.1, 2.0])
    solution = minimise(barrier, x, lambda r: 100 * r, 1e-9)
    assert solution.converged
    np.testing.assert_allclose(x, 1, atol=1e-8)


def test_a_start_at_infinite_energy_is_reported_and_left_alone() -> None:
    x = np.array([-1.0, 1.0])
    solution = minimise(barrier, x, identity, 1e-9)
    assert (solution.reason, solution.iterations, solution.evaluations) == (Reason.INFINITE_START, 0, 1)
    assert x.tolist() == [-1.0, 1.0]


def test_a_line_search_without_decrease_is_reported_and_takes_no_step() -> None:
    x = np.ones(3)
    solution = minimise(climbing, x, identity, 1e-9)
    assert solution.reason == Reason.NO_DECREASE and not solution.converged
    assert solution.value == 1.5
    assert x.tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("limit", [1, 2, 5, 10])
@pytest.mark.parametrize("start", [(-1.2, 1.0), (2.0, 30.0), (-50.0, 7.0)])
def test_a_spent_iteration_limit_is_reported_and_the_result_no_worse_than_the_start(
    start: tuple[float, float], limit: int
) -> None:
    x = np.array(start)
    before = rosenbrock(x, np.empty(2))
    solution = minimise(rosenbrock, x, identity, 1e-12, max_iterations=limit)
    assert (solution.reason, solution.iterations) == (Reason.ITERATIONS_SPENT, limit)
    assert solution.value < before
    assert solution.value == rosenbrock(x, np.empty(2))


def test_a_start_at_the_minimum_takes_no_iteration() -> None:
    solution = minimise(rosenbrock, np.ones(2), identity, 1e-9)
    assert (solution.reason, solution.iterations, solution.evaluations) == (Reason.CONVERGED, 0, 1)


def test_rounding_does_not_stop_it_short_of_a_tight_tolerance() -> None:
    A, b, x = spd(10, 1e3), 1e3 * np.ones(10), np.zeros(10)

    def lifted(x: Array, gradient: Array) -> float:
        return quadratic(A, b)(x, gradient) + 1e7

    assert minimise(lifted, x, lambda r: r / 1e3, 1e-9).converged
    np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=1e-6)


def test_the_preconditioner_may_be_renewed_on_the_way() -> None:
    A, b, x = spd(30, 1e5), np.ones(30), np.zeros(30)
    inverse = np.eye(30)
    asked: list[int] = []

    def refresh(x: Array, iteration: int) -> bool:
        nonlocal inverse
        asked.append(iteration)
        if iteration == 5:
            inverse = np.linalg.inv(A)
        return iteration == 5

    solution = minimise(quadratic(A, b), x, lambda r: inverse @ r, 1e-8, refresh=refresh)
    assert solution.converged and solution.iterations == 6
    assert asked == list(range(6))


def test_a_renewed_preconditioner_forgets_the_pairs_before_it() -> None:
    A, b, kept, none = spd(12, 1e3), np.ones(12), np.zeros(12), np.zeros(12)
    renewed = minimise(quadratic(A, b), kept, lambda r: r / 1e3, 1e-8, max_iterations=40, refresh=lambda *_: True)
    plain = minimise(quadratic(A, b), none, lambda r: r / 1e3, 1e-8, max_iterations=40, pairs=0)
    np.testing.assert_array_equal(kept, none)
    assert renewed == plain


def test_a_direction_that_climbs_is_replaced_by_the_preconditioned_gradient() -> None:
    A, b, x, calls = spd(12, 30), np.ones(12), np.zeros(12), 0

    def wrong_once(r: Array) -> Array:
        nonlocal calls
        calls += 1
        return -r if calls == 3 else r / 30

    solution = minimise(quadratic(A, b), x, wrong_once, 1e-8)
    assert solution.converged
    assert calls == solution.iterations + 1


def pairs(count: int, size: int = 6) -> list[tuple[Array, Array]]:
    """Steps and the gradient differences of a quadratic along them."""
    A, rng = spd(size, 50), np.random.default_rng(3)
    steps = rng.normal(size=(count, size))
    return [(s, A @ s) for s in steps]


@pytest.mark.parametrize("count", [0, 1, 3, 4, 5, 9])
def test_the_direction_is_that_of_dense_bfgs_over_the_last_pairs(count: int) -> None:
    window, H0 = 4, spd(6, 3, seed=4)
    memory, H = Memory(window, 6), H0
    for s, y in pairs(count):
        memory.add(s, y)
    for s, y in pairs(count)[-window:]:
        shear = np.eye(6) - np.outer(s, y) / (s @ y)
        H = shear @ H @ shear.T + np.outer(s, s) / (s @ y)
    g = np.random.default_rng(5).normal(size=6)
    np.testing.assert_allclose(memory.direction(g, lambda r: H0 @ r), -H @ g, atol=1e-10)


def test_the_newest_pair_satisfies_the_secant_equation() -> None:
    memory = Memory(3, 6)
    for s, y in pairs(5):
        memory.add(s, y)
        np.testing.assert_allclose(memory.direction(y, identity), -s, atol=1e-10)


def test_a_pair_of_no_or_negative_curvature_is_not_kept() -> None:
    memory, s = Memory(3, 6), np.ones(6)
    memory.add(s, -s)
    memory.add(s, np.array([1.0, -1, 1, -1, 1, -1]))
    memory.add(s, 0 * s)
    np.testing.assert_array_equal(memory.direction(s, identity), -s)


def test_a_cleared_memory_starts_from_the_preconditioner() -> None:
    memory = Memory(3, 6)
    memory.add(*pairs(1)[0])
    memory.clear()
    np.testing.assert_array_equal(memory.direction(np.ones(6), identity), -np.ones(6))


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_has_words_and_only_one_means_success(reason: Reason) -> None:
    assert reason.words
    assert (reason.words == "converged") == (reason == Reason.CONVERGED)
