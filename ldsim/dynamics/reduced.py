"""The reduced step, compiled: minimises the incremental potential with nothing of Python inside (paper, Sec. 5.2)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ldsim.dynamics.reduced_potential import (
    Reduced,
    Springs,
    Work,
    add_spring_metric,
    current_tangent,
    inner,
    rest_metric,
    value_gradient,
)
from ldsim.reduction.decoder import decode, decode_jacobian
from ldsim.solvers.lbfgs import EPSILON, MAX_BACKTRACKS, accepts, backward_loop, forward_loop, next_step
from ldsim.solvers.solution import Reason

Array = NDArray[np.float64]

CONVERGED = int(Reason.CONVERGED)
ITERATIONS_SPENT = int(Reason.ITERATIONS_SPENT)
NO_DECREASE = int(Reason.NO_DECREASE)
INFINITE_START = int(Reason.INFINITE_START)


class Options(NamedTuple):
    """How to minimise: L-BFGS, or Newton with the decoder's second derivative dropped.

    tolerance: stop at ‖∇E‖ ≤ tolerance · max(‖z‖, 1). current: precondition with the tangent at a state of the motion,
    not at rest. newton: renew it in every iteration and keep no memory. renewal: iterations after which L-BFGS renews
    the preconditioner within a step and starts its memory anew.
    """

    tolerance: float
    max_iterations: int
    current: bool
    newton: bool
    renewal: int


@njit(cache=True, nogil=True)
def _cholesky(A: Array) -> bool:
    """Lower Cholesky factor in place; a pivot lost to rounding is replaced by a small share of the trace."""
    r = A.shape[0]
    trace = 0.0
    for a in range(r):
        trace += A[a, a]
    floor = 1e-13 * trace
    if not (trace > 0.0 and trace < math.inf):
        return False
    for a in range(r):
        for b in range(a + 1):
            total = A[a, b]
            for j in range(b):
                total -= A[a, j] * A[b, j]
            if a == b:
                A[a, a] = math.sqrt(max(total, floor))
            else:
                A[a, b] = total / A[b, b]
    return True


@njit(cache=True, nogil=True)
def _solve_cholesky(L: Array, x: Array) -> None:
    r = L.shape[0]
    for a in range(r):
        total = x[a]
        for b in range(a):
            total -= L[a, b] * x[b]
        x[a] = total / L[a, a]
    for a in range(r - 1, -1, -1):
        total = x[a]
        for b in range(a + 1, r):
            total -= L[b, a] * x[b]
        x[a] = total / L[a, a]


@njit(cache=True, nogil=True)
def _precondition(model: Reduced, springs: Springs, options: Options, work: Work) -> bool:
    """Factorises the preconditioner at the state last decoded."""
    if model.layers.sizes.shape[0] > 1:
        decode_jacobian(model.layers, work.hidden, work.scratch, work.jacobian)
    if options.current:
        current_tangent(model, work)
    else:
        rest_metric(model, work)
    add_spring_metric(springs, model, work)
    return _cholesky(work.hessian)


@njit(cache=True, nogil=True)
def _direction(factor: Array, newest: int, count: int, work: Work) -> float:
    """Writes −H g into work.d by the two-loop recursion around the preconditioner; returns its slope g·d."""
    d = work.d
    for i in range(d.shape[0]):
        d[i] = -work.g[i]
    backward_loop(work.S, work.Y, work.rho, work.alpha, newest, count, d)
    _solve_cholesky(factor, d)
    forward_loop(work.S, work.Y, work.rho, work.alpha, newest, count, d)
    return inner(work.g, d)


@njit(cache=True, nogil=True)
def _search(
    model: Reduced, springs: Springs, predictor: Array, z: Array, f: float, slope: float, work: Work
) -> tuple[bool, float, int]:
    """Line search from z along work.d into work.z_new, work.g_new; whether it succeeded, E there, evaluations."""
    d, length = work.d, 1.0
    for evaluations in range(1, MAX_BACKTRACKS + 1):
        for i in range(z.shape[0]):
            work.z_new[i] = z[i] + length * d[i]
        f_new = value_gradient(model, springs, predictor, work.z_new, work, work.g_new)
        slope_new = inner(work.g_new, d) if f_new < math.inf else math.inf
        if accepts(f, slope, length, f_new, slope_new):
            return True, f_new, evaluations
        length = next_step(f, slope, length, f_new, slope_new)
        if length * math.sqrt(inner(d, d)) <= EPSILON * math.sqrt(inner(z, z)):
            return False, f, evaluations
    return False, f, MAX_BACKTRACKS


@njit(cache=True, nogil=True)
def step(
    model: Reduced,
    springs: Springs,
    predictor: Array,
    start: Array,
    z: Array,
    factor: Array,
    renew: bool,
    options: Options,
    work: Work,
) -> tuple[int, int, int, float, float]:
    """One step of implicit Euler from q̂ = 2qₙ − qₙ₋₁ (paper, Eq. 12).

    Args:
        predictor: q̂, (k,).
        start: the initial guess, (r,); where its energy is infinite, z is used instead.
        z: zₙ on entry, zₙ₊₁ on return, (r,); φ(z) is left in work.q.
        factor: Cholesky factor of the preconditioner, (r, r); overwritten when it is renewed.
        renew: whether to renew it at the start of this step.

    Returns:
        iterations, evaluations, reason (`solvers.Reason`), E(z) in J, ‖∇E‖ in N. z is never left at a point of
        infinite energy unless it was given there.
    """
    g = work.g
    evaluations = 1
    f = value_gradient(model, springs, predictor, start, work, g)
    if f < math.inf:
        z[:] = start
    else:
        f = value_gradient(model, springs, predictor, z, work, g)
        evaluations += 1
    if not f < math.inf:
        return 0, evaluations, INFINITE_START, f, math.inf
    newest, count = -1, 0
    for iteration in range(options.max_iterations):
        norm = math.sqrt(inner(g, g))
        if norm <= options.tolerance * max(math.sqrt(inner(z, z)), 1.0):
            return iteration, evaluations, CONVERGED, f, norm
        if (renew and iteration == 0) or options.newton or (iteration > 0 and iteration % options.renewal == 0):
            decode(model.layers, z, work.hidden, work.q)
            if _precondition(model, springs, options, work):
                factor[:] = work.hessian
            count = 0
        slope = _direction(factor, newest, count, work)
        if not slope < 0.0:
            count = 0
            slope = _direction(factor, newest, count, work)
        accepted, f_new, tried = _search(model, springs, predictor, z, f, slope, work)
        evaluations += tried
        if not accepted:
            decode(model.layers, z, work.hidden, work.q)
            return iteration, evaluations, NO_DECREASE, f, norm
        if not options.newton:
            newest, count = _remember(work, z, newest, count)
        z[:] = work.z_new
        g[:] = work.g_new
        f = f_new
    return options.max_iterations, evaluations, ITERATIONS_SPENT, f, math.sqrt(inner(g, g))


@njit(cache=True, nogil=True)
def _remember(work: Work, z: Array, newest: int, count: int) -> tuple[int, int]:
    """Store the pair (s, y) if its curvature is safely positive; returns the ring's newest and count."""
    window = work.S.shape[0]
    slot = (newest + 1) % window
    sy, ss, yy = 0.0, 0.0, 0.0
    for i in range(z.shape[0]):
        s, y = work.z_new[i] - z[i], work.g_new[i] - work.g[i]
        sy += s * y
        ss += s * s
        yy += y * y
    if sy <= 1e-14 * math.sqrt(ss * yy):
        return newest, count
    for i in range(z.shape[0]):
        work.S[slot, i] = work.z_new[i] - z[i]
        work.Y[slot, i] = work.g_new[i] - work.g[i]
    work.rho[slot] = 1.0 / sy
    return slot, min(count + 1, window)
