"""Non-negative least squares on normal equations, warm-started: the inner loops of Lawson and Hanson.

min ½ xᵀ G x − cᵀ x over x ≥ 0 with G = AᵀA, c = Aᵀb (Bro and De Jong 1997, "A fast non-negativity-constrained least
squares algorithm"). Columns are expected to have unit length, so that one ridge fits all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from ldsim.arrays import Array

# Keeps two equal columns solvable; they then share their weight.
RIDGE = 1e-13
# A slope below this share of the largest at zero is rounding; each variable joins a few times at most.
SLOPE = 1e-12
JOINS = 3


def solve_on_support(gram: Array, moments: Array, start: Array, support: NDArray[np.bool_]) -> Array:
    """The non-negative solution on a support that shrinks: a variable that would turn negative leaves it.

    The inner loop of Lawson and Hanson 1974, "Solving Least Squares Problems", Sec. 23.3: from the feasible `start` go
    towards the unconstrained solution on the support until a variable reaches zero, drop it, and repeat.

    Args:
        gram, moments: G (m, m) and c (m,).
        start: feasible, zero off the support, (m,).
        support: the variables that may be positive, (m,) bool.

    Returns:
        x (m,), positive on what is left of the support and the least-squares solution there.
    """
    x, support = start.copy(), support.copy()
    while support.any():
        goal = np.zeros_like(x)
        goal[support] = _solve(gram[np.ix_(support, support)], moments[support])
        blocked = np.flatnonzero(support & (goal <= 0))
        if len(blocked) == 0:
            return goal
        fractions = x[blocked] / np.maximum(x[blocked] - goal[blocked], np.finfo(float).tiny)
        x += fractions.min() * (goal - x)
        support[blocked[fractions <= fractions.min()]] = False
        x[~support] = 0.0
    return np.zeros_like(start)


def nnls(gram: Array, moments: Array) -> Array:
    """The solution, (m,): the steepest variable joins the support until none would lower the objective.

    Lawson and Hanson 1974, Sec. 23.3, Algorithm NNLS.
    """
    x = np.zeros(len(moments))
    for _ in range(JOINS * len(moments)):
        slopes = np.where(x > 0, -np.inf, moments - gram @ x)
        if len(x) == 0 or not slopes.max() > SLOPE * np.abs(moments).max():
            break
        support = x > 0
        support[slopes.argmax()] = True
        following = solve_on_support(gram, moments, x, support)
        if np.array_equal(following, x):
            break
        x = following
    return x


def losses_without(gram: Array, x: Array) -> Array:
    """What the squared residual grows by when a variable of the support is left out, (m,); infinite off the support.

    x_j² / (G⁻¹)_jj on the support: exact for least squares, a lower bound where others would turn negative.
    """
    support = np.flatnonzero(x > 0)
    inverse = _solve(gram[np.ix_(support, support)], np.eye(len(support)))
    losses = np.full(len(x), np.inf)
    losses[support] = x[support] ** 2 / np.diag(inverse)
    return losses


def _solve(gram: Array, right: Array) -> Array:
    return cho_solve(cho_factor(gram + RIDGE * len(gram) * np.eye(len(gram))), right)
