"""L-BFGS with a preconditioner in the middle of the two-loop recursion (Nocedal and Wright 2006, Alg. 7.4, 7.5).

The compiled pieces work on rings of `window` pairs (window, d) and are shared by the full space, whose loop is below,
and by the compiled reduced step (dynamics/reduced/minimiser.py).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ldsim.arrays import Array
from ldsim.jit import kernel
from ldsim.optimise.line_search import EPSILON, MAX_BACKTRACKS, ROUNDOFF, accepts, next_step
from ldsim.optimise.solution import Reason, Solution

# A pair is kept above this cosine between s and y: no Hessian that doubles can hold has one below √ε, and the estimate
# of its inverse grows with the reciprocal.
CURVED = math.sqrt(EPSILON)


@kernel()
def backward_loop(S: Array, Y: Array, rho: Array, alpha: Array, newest: int, count: int, d: Array) -> None:
    """First half of the two-loop recursion: d ← d − Σ αᵢ yᵢ, newest pair first."""
    window = S.shape[0]
    for step in range(count):
        # a ring: the newest pair overwrites the oldest, so nothing is moved
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
        # where the energy curves down, the pair would make H indefinite and the next direction uphill
        curvature = float(s @ y)
        if curvature <= CURVED * math.sqrt(float(s @ s) * float(y @ y)):
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
    pairs: int = 8,
    max_iterations: int = 500,
    refresh: Callable[[Array, int], bool] | None = None,
    deadline: float = math.inf,
    noise: float = 0.0,
) -> Solution:
    """Minimise from x, in place, until ‖g‖ ≤ tolerance · max(‖x‖, 1) (paper, Sec. 5.2).

    Args:
        objective: (x, gradient to overwrite) → value; infinite values are backed away from.
        x: start and result, (d,) float64.
        precondition: an approximate inverse Hessian applied to a vector.
        pairs: of steps and gradient changes to keep; with none, and the inverse Hessian to precondition with, this is
            Newton's method.
        refresh: called before each iteration with x and the iterations so far; true means that the preconditioner
            was changed, so the memory starts anew.
        deadline: on the clock of `time.perf_counter`, after which no further iteration or evaluation is begun.
        noise: of a value, where it is a sum of terms that cancel: values closer than it are told apart by their slopes.

    Returns:
        The record of the solve; x is never worse than where it started.
    """
    memory = Memory(pairs, len(x))
    g, g_new = np.empty_like(x), np.empty_like(x)
    f = objective(x, g)
    evaluations = 1
    if not math.isfinite(f):
        return Solution(f, math.inf, 0, evaluations, Reason.INFINITE_START)
    for iteration in range(max_iterations):
        norm = float(np.linalg.norm(g))
        if norm <= tolerance * max(float(np.linalg.norm(x)), 1.0):
            return Solution(f, norm, iteration, evaluations, Reason.CONVERGED)
        if time.perf_counter() > deadline:
            return Solution(f, norm, iteration, evaluations, Reason.ITERATIONS_SPENT)
        if refresh is not None and refresh(x, iteration):
            memory.clear()
        d = memory.direction(g, precondition)
        slope = float(g @ d)
        # rounding, or a preconditioner that has grown old, can turn the direction uphill: then without the memory
        if slope >= 0.0:
            memory.clear()
            d = precondition(-g)
            slope = float(g @ d)
        trial = _search(objective, _Ray(x, d, f, slope), g_new, deadline, noise)
        evaluations += trial.evaluations
        if trial.failure is not None:
            return Solution(f, norm, iteration, evaluations, trial.failure)
        memory.add(trial.x - x, g_new - g)
        x[:] = trial.x
        f, g, g_new = trial.f, g_new, g
    return Solution(f, float(np.linalg.norm(g)), max_iterations, evaluations, Reason.ITERATIONS_SPENT)


class _Ray(NamedTuple):
    """A point, a direction from it, and the objective and its slope there."""

    x: Array
    d: Array
    f: float
    slope: float


class _Trial(NamedTuple):
    """The last point that a line search tried; why it is not taken, if it is not."""

    x: Array
    f: float
    evaluations: int
    failure: Reason | None


def _search(objective: Objective, ray: _Ray, g: Array, deadline: float, noise: float) -> _Trial:
    """Line search along the ray; the gradient where it ends is written into g."""
    step, least = 1.0, noise / ROUNDOFF
    lift = 0.0 if abs(ray.f) >= least else least - ray.f  # beside a value so large the noise is rounding
    for evaluations in range(1, MAX_BACKTRACKS + 1):
        x = ray.x + step * ray.d
        f = objective(x, g)
        slope = float(g @ ray.d) if math.isfinite(f) else math.inf
        if accepts(ray.f + lift, ray.slope, step, f + lift, slope):
            return _Trial(x, f, evaluations, None)
        if time.perf_counter() > deadline:
            return _Trial(x, f, evaluations, Reason.ITERATIONS_SPENT)
        step = next_step(ray.f + lift, ray.slope, step, f + lift, slope)
        # a shorter step would not change x any more
        if step * math.sqrt(float(ray.d @ ray.d)) <= EPSILON * math.sqrt(float(ray.x @ ray.x)):
            break
    return _Trial(x, f, evaluations, Reason.NO_DECREASE)
