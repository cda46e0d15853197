"""The reduced step, compiled: minimises the incremental potential with nothing of Python inside (paper, Sec. 5.2)."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from ldsim.arrays import Array
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work, inner, value_gradient
from ldsim.dynamics.reduced.tangent import add_spring_metric, current_tangent, rest_metric
from ldsim.jit import copy, kernel
from ldsim.optimise.line_search import EPSILON, MAX_BACKTRACKS, accepts, next_step
from ldsim.optimise.minimiser import CURVED, backward_loop, forward_loop
from ldsim.optimise.solution import Reason
from ldsim.space.decoder import REASSOCIATE, decode, decode_jacobian, decode_vjp

CONVERGED = int(Reason.CONVERGED)
ITERATIONS_SPENT = int(Reason.ITERATIONS_SPENT)
NO_DECREASE = int(Reason.NO_DECREASE)
INFINITE_START = int(Reason.INFINITE_START)


class Method(IntEnum):
    """How the inverse Hessian H of the quasi-Newton direction −H ∇E comes about.

    LBFGS: two-loop recursion of the last pairs around the preconditioner (paper, Sec. 5.2). BFGS: the preconditioner
    itself is updated by every pair (Nocedal and Wright 2006, Eq. 6.17) and goes on from step to step. NEWTON: the
    inverse of the tangent at every iterate, the decoder's second derivative dropped (Gauss–Newton in the latent space,
    Newton in the linear one).
    """

    LBFGS = 0
    BFGS = 1
    NEWTON = 2


# Of the curvature along a spring that goes, for the rest to be known by the difference.
LEAST_LEFT = 0.1
LBFGS, NEWTON = int(Method.LBFGS), int(Method.NEWTON)
# Of the weak Wolfe condition: the least share of the first slope that is left (Nocedal and Wright 2006, Sec. 3.1).
CURVATURE = 0.9


class Minimisation(NamedTuple):
    """How to minimise.

    tolerance: stop at ‖∇E‖ ≤ tolerance · max(‖z‖, 1), or at its rounding. method: a number of `Method`. current:
    precondition with the tangent at a state of the motion, not at rest. renewal: iterations after which the
    preconditioner is renewed within a step and the memory starts anew. extrapolate: start where earlier steps lead to.
    wolfe: which line search.
    """

    tolerance: float
    max_iterations: int
    method: int
    current: bool
    renewal: int
    extrapolate: bool
    wolfe: bool


class Exchange(NamedTuple):
    """What becomes of the preconditioner of the step before: made anew, or, where others are held, exchanged in it are
    the springs, (3g, k) each, B times the root of the stiffness."""

    renew: bool
    others: bool
    held: Array
    released: Array


@kernel()
def cholesky(A: Array) -> bool:
    """Lower Cholesky factor in place; a pivot lost to rounding is replaced by a small share of the trace."""
    r = A.shape[0]
    trace = 0.0
    for a in range(r):
        trace += A[a, a]
    floor = 1e-13 * trace
    if not (trace > 0.0 and trace < math.inf):
        return False
    for a in range(r):
        # row by row, so that both inner loops run along memory
        for b in range(a + 1):
            total = A[a, b]
            for j in range(b):
                total -= A[a, j] * A[b, j]
            if a == b:
                A[a, a] = math.sqrt(max(total, floor))
            else:
                A[a, b] = total / A[b, b]
    return True


@kernel()
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


@kernel()
def _precondition(model: Reduced, springs: Springs, z: Array, options: Minimisation, H: Array, work: Work) -> None:
    """H ← the inverse of the tangent at z or at rest; kept as it is where that has no factor."""
    decode(model.layers, z, work.hidden, work.q)
    if model.layers.sizes.shape[0] > 1:
        decode_jacobian(model.layers, work.hidden, work.tangents, work.jacobian)
    if options.current:
        current_tangent(model, work)
    else:
        rest_metric(model, work)
    add_spring_metric(springs, model, work)
    # the inverse and not the factor: a product with it needs no loop that waits for itself, and BFGS updates it
    if cholesky(work.hessian):
        for a in range(H.shape[0]):
            H[a] = 0.0
            H[a, a] = 1.0
            _solve_cholesky(work.hessian, H[a])


@kernel()
def exchange_springs(model: Reduced, exchange: Exchange, H: Array, work: Work) -> bool:
    """The springs that are held come into H, and those released go, at the z that was decoded last."""
    fine = True
    for i in range(exchange.held.shape[0]):
        fine = fine and _exchange_spring(model, exchange.held[i], 1.0, H, work)
    for i in range(exchange.released.shape[0]):
        fine = fine and _exchange_spring(model, exchange.released[i], -1.0, H, work)
    return fine


@kernel()
def _exchange_spring(model: Reduced, spring: Array, sign: float, H: Array, work: Work) -> bool:
    """H ← (H⁻¹ ± a aᵀ)⁻¹ for the gradient a of a spring of unit stiffness (Sherman and Morrison); whether so much of
    the curvature along a is left that the result can be trusted."""
    a, Ha = work.S[0], work.Hy
    decode_vjp(model.layers, work.hidden, spring, work.scratch, a)
    _multiply(H, a, Ha)
    left = 1.0 + sign * inner(a, Ha)
    if not left > LEAST_LEFT:
        return False
    for i in range(a.shape[0]):
        for j in range(a.shape[0]):
            H[i, j] -= sign / left * Ha[i] * Ha[j]
    return True


@kernel(fastmath=REASSOCIATE)
def _multiply(H: Array, x: Array, out: Array) -> None:
    """out = H x."""
    for i in range(H.shape[0]):
        total = 0.0
        for j in range(H.shape[1]):
            total += H[i, j] * x[j]
        out[i] = total


@kernel()
def _direction(H: Array, newest: int, count: int, work: Work) -> float:
    """Writes the quasi-Newton direction into work.d; returns its slope g·d."""
    d, half = work.d, work.Hy
    for i in range(d.shape[0]):
        half[i] = -work.g[i]
    backward_loop(work.S, work.Y, work.rho, work.alpha, newest, count, half)
    _multiply(H, half, d)
    forward_loop(work.S, work.Y, work.rho, work.alpha, newest, count, d)
    return inner(work.g, d)


@kernel()
def _search(
    model: Reduced, springs: Springs, predictor: Array, z: Array, f: float, slope: float, wolfe: bool, work: Work
) -> tuple[bool, float, int]:
    """Line search from z along work.d into work.z_new, work.g_new; whether it succeeded, E there, evaluations.

    With wolfe, for a step with sufficient decrease after which the slope has risen to `CURVATURE` of the first, by
    bisection, doubling until there is an upper end (Lewis and Overton 2013, Algorithm 2.6).
    """
    d, length, low, high = work.d, 1.0, 0.0, math.inf
    for evaluations in range(1, MAX_BACKTRACKS + 1):
        for i in range(z.shape[0]):
            work.z_new[i] = z[i] + length * d[i]
        f_new = value_gradient(model, springs, predictor, work.z_new, work, work.g_new)
        slope_new = inner(work.g_new, d) if f_new < math.inf else math.inf
        if not accepts(f, slope, length, f_new, slope_new):
            high = length
        elif wolfe and slope_new < CURVATURE * slope:
            low = length
        else:
            return True, f_new, evaluations
        if wolfe:
            length = 0.5 * (low + high) if high < math.inf else 2.0 * low
        else:
            length = next_step(f, slope, length, f_new, slope_new)
        # a shorter step would not change z any more
        if length * math.sqrt(inner(d, d)) <= EPSILON * math.sqrt(inner(z, z)):
            return False, f, evaluations
    return False, f, MAX_BACKTRACKS


@kernel()
def _rounding(model: Reduced, springs: Springs, predictor: Array, z: Array, work: Work) -> float:
    """By how much ‖∇E‖ changes where every coordinate is moved by a rounding, N; φ(z) is left in work.q."""
    for i in range(z.shape[0]):
        work.z_new[i] = z[i] * (1.0 + EPSILON if i % 2 else 1.0 - EPSILON)
    value_gradient(model, springs, predictor, work.z_new, work, work.g_new)
    for i in range(z.shape[0]):
        work.g_new[i] -= work.g[i]
    decode(model.layers, z, work.hidden, work.q)
    return math.sqrt(inner(work.g_new, work.g_new))


@kernel()
def step(
    model: Reduced,
    springs: Springs,
    predictor: Array,
    start: Array,
    z: Array,
    H: Array,
    exchange: Exchange,
    options: Minimisation,
    work: Work,
) -> tuple[int, int, int, float, float]:
    """One step of implicit Euler from q̂ = 2qₙ − qₙ₋₁ (paper, Eq. 12).

    Args:
        predictor: q̂, (k,).
        start: the initial guess, (r,); where its energy is infinite, z is used instead.
        z: zₙ on entry, zₙ₊₁ on return, (r,); φ(z) is left in work.q.
        H: the preconditioner, an estimate of the inverse Hessian, (r, r); overwritten when it is renewed or updated.
        exchange: what becomes of it at the start of this step.

    Returns:
        iterations, evaluations, reason (`solution.Reason`), E in J and ‖∇E‖ in N where it was evaluated last.
    """
    g = work.g
    f, evaluations = _begin(model, springs, predictor, start, z, work)
    if not f < math.inf:
        return 0, evaluations, INFINITE_START, f, math.inf
    newest, count, renewed_at, renew = -1, 0, -1, exchange.renew
    for iteration in range(options.max_iterations):
        norm = math.sqrt(inner(g, g))
        if norm <= options.tolerance * max(math.sqrt(inner(z, z)), 1.0):
            if iteration > 0 or not (exchange.renew or exchange.others):
                _go_on(model, z, H, newest, count, work)
            return iteration, evaluations, CONVERGED, f, norm
        if iteration == 0 and exchange.others and not renew:
            renew = not exchange_springs(model, exchange, H, work)
        overdue = iteration - max(renewed_at, 0) >= options.renewal
        if iteration > 0 and (renew or overdue) and options.method != NEWTON:
            # a step that goes on for long: forces that cancel may leave nothing but their rounding
            evaluations += 1
            if norm <= _rounding(model, springs, predictor, z, work):
                return iteration, evaluations, CONVERGED, f, norm
        if renew or overdue or options.method == NEWTON:
            _precondition(model, springs, z, options, H, work)
            renew, count, renewed_at = False, 0, iteration
        slope = _direction(H, newest, count, work)
        accepted, f_new, tried = False, f, 0
        if slope < 0.0:
            accepted, f_new, tried = _search(model, springs, predictor, z, f, slope, options.wolfe, work)
        evaluations += tried
        if accepted:
            newest, count = _learn(options.method, H, z, newest, count, work)
            copy(work.z_new, z)
            copy(work.g_new, g)
            f = f_new
        elif renewed_at == iteration:
            # with a fresh preconditioner there is nothing better to try
            rounding = _rounding(model, springs, predictor, z, work)
            return iteration, evaluations + 1, CONVERGED if norm <= rounding else NO_DECREASE, f, norm
        else:
            renew = True
    return options.max_iterations, evaluations, ITERATIONS_SPENT, f, math.sqrt(inner(g, g))


@kernel()
def _go_on(model: Reduced, z: Array, H: Array, newest: int, count: int, work: Work) -> None:
    """One more step from where the minimiser may stop, without looking at E there: z is then ten times as near to the
    minimum, for the price of a decoder."""
    _direction(H, newest, count, work)
    for i in range(z.shape[0]):
        z[i] += work.d[i]
    decode(model.layers, z, work.hidden, work.q)


@kernel()
def _begin(model: Reduced, springs: Springs, predictor: Array, start: Array, z: Array, work: Work) -> tuple[float, int]:
    """z ← start, unless its energy is infinite; E(z), with its gradient in work.g, and the evaluations."""
    f = value_gradient(model, springs, predictor, start, work, work.g)
    if f < math.inf:
        copy(start, z)
        return f, 1
    return value_gradient(model, springs, predictor, z, work, work.g), 2


@kernel()
def _learn(method: int, H: Array, z: Array, newest: int, count: int, work: Work) -> tuple[int, int]:
    """What a step from z to work.z_new tells of the Hessian; returns the ring's newest and count."""
    if method == LBFGS:
        return _remember(work, z, newest, count)
    if method != NEWTON:
        _update(H, z, work)
    return newest, count


@kernel()
def _remember(work: Work, z: Array, newest: int, count: int) -> tuple[int, int]:
    """Store the pair (s, y) if its curvature is safely positive; returns the ring's newest and count."""
    slot = (newest + 1) % work.S.shape[0]
    s, y = work.S[slot], work.Y[slot]
    curvature = _pair(z, s, y, work)
    if curvature <= 0.0:
        # The oldest pair is spoilt: a full ring forgets it.
        return newest, min(count, work.S.shape[0] - 1)
    work.rho[slot] = 1.0 / curvature
    return slot, min(count + 1, work.S.shape[0])


@kernel()
def _update(H: Array, z: Array, work: Work) -> None:
    """H ← (1 − s yᵀ/sy) H (1 − y sᵀ/sy) + s sᵀ/sy, if the curvature sy of the last pair is safely positive."""
    s, y, Hy = work.S[0], work.Y[0], work.Hy
    sy = _pair(z, s, y, work)
    if sy <= 0.0:
        return
    # expanded into two outer products, so that H is read and written once
    _multiply(H, y, Hy)
    scale = (1.0 + inner(y, Hy) / sy) / sy
    for i in range(s.shape[0]):
        a, b = scale * s[i] - Hy[i] / sy, s[i] / sy
        for j in range(s.shape[0]):
            H[i, j] += a * s[j] - b * Hy[j]


@kernel()
def _pair(z: Array, s: Array, y: Array, work: Work) -> float:
    """Writes s = z_new − z and y = g_new − g; returns s·y, or 0 where it is not safely positive."""
    for i in range(z.shape[0]):
        s[i] = work.z_new[i] - z[i]
        y[i] = work.g_new[i] - work.g[i]
    sy = inner(s, y)
    return sy if sy > CURVED * math.sqrt(inner(s, s) * inner(y, y)) else 0.0
