"""L-BFGS with a preconditioner in the middle of the two-loop recursion (Nocedal and Wright 2006, Alg. 7.4, 7.5).

The compiled pieces work on rings of `window` pairs (window, d) and are shared by the full space, whose loop is below,
and by the compiled reduced step (dynamics/reduced.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ldsim.jit import kernel
from ldsim.optimise.solution import Reason, Solution

Array = NDArray[np.float64]

ARMIJO = 1e-4
# Values closer than this share are told apart by their slopes: the potential is a sum of large terms that cancel.
ROUNDOFF = 1e-10
MAX_BACKTRACKS = 40
EPSILON = 2.0**-52


@kernel()
def backward_loop(S: Array, Y: Array, rho: Array, alpha: Array, newest: int, count: int, d: Array) -> None:
    """First half of the two-loop recursion: d ← d − Σ αᵢ yᵢ, newest pair first."""
    window = S.shape[0]
    for step in range(count):
        i = (newest - step) % window
        total = 0.0
        for j in range(d.shape[0]):
            total += S[i, j] * d[j]
        alpha[i] = rho[i] * total
        for j in range(d.shape[0]):
            d[j] -= alpha[i] * Y[i, j]


@kernel()
def forward_loop(S: Array, Y: Array, rho: Array, alpha: Array, newest: int, count: int, d: Array) -> None:
    """Second half, after the preconditioner was applied to d: oldest pair first."""
    window = S.shape[0]
    for step in range(count - 1, -1, -1):
        i = (newest - step) % window
        total = 0.0
        for j in range(d.shape[0]):
            total += Y[i, j] * d[j]
        beta = alpha[i] - rho[i] * total
        for j in range(d.shape[0]):
            d[j] += beta * S[i, j]


@kernel()
def accepts(f0: float, slope0: float, step: float, f: float, slope: float) -> bool:
    """Sufficient decrease, or its form in the slopes where the values differ only by rounding.

    Armijo: f ≤ f₀ + c₁ α φ'(0). While |f − f₀| is at the level of rounding, φ'(α) ≤ (2c − 1) φ'(0) with c = 0.1 instead
    (Hager and Zhang 2005, Eq. 4.1), and the slope has risen from φ'(0) by a tenth or more, so that steps of
    rounding size are not accepted without end.
    """
    if not f < math.inf:
        return False
    if abs(f - f0) <= ROUNDOFF * abs(f0):
        return 0.9 * slope0 <= slope <= -0.8 * slope0
    return f <= f0 + ARMIJO * step * slope0


@kernel()
def next_step(f0: float, slope0: float, step: float, f: float, slope: float) -> float:
    """The step to try after one that was not accepted.

    Where the values tell, the minimiser of the parabola through f₀, φ'(0) and f, kept within a tenth and a half of the
    step; where they differ only by rounding, the root of the secant through both slopes, at most ten times the step.
    """
    if not f < math.inf:
        return 0.25 * step
    if abs(f - f0) <= ROUNDOFF * abs(f0):
        return step * min(max(slope0 / min(slope0 - slope, -1e-300), 0.1), 10.0) if slope > slope0 else 10.0 * step
    curvature = f - f0 - slope0 * step
    if curvature <= 0.0:
        return 0.5 * step
    return min(max(-0.5 * slope0 * step * step / curvature, 0.1 * step), 0.5 * step)


Objective = Callable[[Array, Array], float]


class Memory:
    """The ring of pairs (s, y) of the last `window` steps in a space of `size` unknowns."""

    def __init__(self, window: int, size: int) -> None:
        self.S = np.zeros((window, size))
        self.Y = np.zeros((window, size))
        self.rho = np.zeros(window)
        self._alpha = np.zeros(window)
        self._newest = -1
        self._count = 0

    def clear(self) -> None:
        self._newest, self._count = -1, 0

    def add(self, s: Array, y: Array) -> None:
        """Keep the pair if its curvature s·y is safely positive, and if anything is kept."""
        if len(self.S) == 0:
            return
        curvature = float(s @ y)
        if curvature <= 1e-14 * math.sqrt(float(s @ s) * float(y @ y)):
            return
        self._newest = (self._newest + 1) % len(self.S)
        self._count = min(self._count + 1, len(self.S))
        self.S[self._newest], self.Y[self._newest], self.rho[self._newest] = s, y, 1 / curvature

    def direction(self, gradient: Array, precondition: Callable[[Array], Array]) -> Array:
        """−H gradient, with H the inverse Hessian's estimate that starts from `precondition`."""
        d = -gradient
        state = (self.S, self.Y, self.rho, self._alpha, self._newest, self._count)
        backward_loop(*state, d)
        d = precondition(d)
        forward_loop(*state, d)
        return d


def minimise(
    objective: Objective,
    x: Array,
    precondition: Callable[[Array], Array],
    tolerance: float,
    window: int = 8,
    max_iterations: int = 500,
    refresh: Callable[[Array, int], bool] | None = None,
) -> Solution:
    """Minimise from x, in place, until ‖g‖ ≤ tolerance · max(‖x‖, 1) (paper, Sec. 5.2).

    Args:
        objective: (x, gradient to overwrite) → value; infinite values are backed away from.
        x: start and result, (d,) float64.
        precondition: an approximate inverse Hessian applied to a vector.
        window: pairs to keep; with none, and a preconditioner that is the inverse Hessian, this is Newton's method.
        refresh: called before each iteration with x and the iterations so far; true means that the preconditioner
            was changed, so the memory starts anew.

    Returns:
        The record of the solve; x is never worse than where it started.
    """
    memory = Memory(window, len(x))
    g, g_new = np.empty_like(x), np.empty_like(x)
    f = objective(x, g)
    evaluations = 1
    if not math.isfinite(f):
        return Solution(f, math.inf, 0, evaluations, Reason.INFINITE_START)
    for iteration in range(max_iterations):
        norm = float(np.linalg.norm(g))
        if norm <= tolerance * max(float(np.linalg.norm(x)), 1.0):
            return Solution(f, norm, iteration, evaluations, Reason.CONVERGED)
        if refresh is not None and refresh(x, iteration):
            memory.clear()
        d = memory.direction(g, precondition)
        slope = float(g @ d)
        if slope >= 0.0:
            memory.clear()
            d = precondition(-g)
            slope = float(g @ d)
        step = 1.0
        for _ in range(MAX_BACKTRACKS):
            trial = x + step * d
            f_new = objective(trial, g_new)
            evaluations += 1
            slope_new = float(g_new @ d) if math.isfinite(f_new) else math.inf
            if accepts(f, slope, step, f_new, slope_new):
                break
            step = next_step(f, slope, step, f_new, slope_new)
            if step * math.sqrt(float(d @ d)) <= EPSILON * math.sqrt(float(x @ x)):
                return Solution(f, norm, iteration, evaluations, Reason.NO_DECREASE)
        else:
            return Solution(f, norm, iteration, evaluations, Reason.NO_DECREASE)
        memory.add(trial - x, g_new - g)
        x[:] = trial
        f, g, g_new = f_new, g_new, g
    return Solution(f, float(np.linalg.norm(g)), max_iterations, evaluations, Reason.ITERATIONS_SPENT)
