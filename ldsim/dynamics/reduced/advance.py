"""One call from state to state: all that a step reads is handed to compiled code by one reference.

Passing the arrays themselves costs half a microsecond each, and a model has fifty: more than the step computes. A
reference costs two.
"""

from __future__ import annotations

import math
from typing import Any

from numba.core import types
from numba.experimental import structref

from ldsim.arrays import Array
from ldsim.dynamics.reduced.in_series import InSeries
from ldsim.dynamics.reduced.minimiser import Exchange, Minimisation, step
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work
from ldsim.dynamics.reduced.state import fields
from ldsim.dynamics.reduced.warped import most_beside, swing_on, warp_springs
from ldsim.jit import njit


@structref.register
class _Reference(types.StructRef):
    """The compiled side of `StepReference`."""

    def preprocess_fields(self, fields: tuple[tuple[str, types.Type], ...]) -> tuple[tuple[str, types.Type], ...]:
        return tuple((name, types.unliteral(kind)) for name, kind in fields)  # type: ignore[no-untyped-call]


class StepReference(structref.StructRefProxy):
    """Named tuples of arrays behind one reference; the arrays are shared, the numbers copied."""

    content: Any

    def __new__(cls, content: tuple[object, ...]) -> StepReference:
        made: StepReference = structref.StructRefProxy.__new__(cls, content)  # type: ignore[no-untyped-call]
        return made


structref.define_proxy(StepReference, _Reference, ["content"])  # type: ignore[no-untyped-call]


def step_reference(
    model: Reduced, springs: Springs, options: Minimisation, work: Work, series: InSeries
) -> StepReference:
    """What stays from step to step; targets and stiffnesses of the grabs may be changed in place."""
    return StepReference((model, springs, options, work, series))


@njit(cache=True, nogil=True)
def warp(reference: StepReference, q: Array) -> None:
    """Warp the springs of a condensed space as it is at coordinates q, (k,)."""
    model, springs, _, work, series = reference.content
    if len(series.softness) > 0:
        warp_springs(series, model, q, springs, work)


@njit(cache=True, nogil=True)
def beside(reference: StepReference, q: Array, products: Array, amounts: Array) -> float:
    """The most that grabs move beside the coordinates of a condensed space at q, (k,), see `most_beside`."""
    model, springs, _, work, series = reference.content
    warp_springs(series, model, q, springs, work)
    return float(most_beside(series, products, amounts))


@njit(cache=True, nogil=True)
def advance(
    reference: StepReference,
    state: Array,
    renew: bool,
    others: bool,
    new: Array,
) -> tuple[int, int, int, float, float]:
    """One step of implicit Euler; see `reduced.step` for what is returned.

    Args:
        state: `ReducedState.data`; left as it is.
        renew: make the preconditioner anew. others: other grabs are held than in the step before.
        new: that of the new state; overwritten.
    """
    reduced, springs, options, work, series = reference.content
    r, k = work.g.shape[0], work.q.shape[0]
    z, z_previous, guess, q, q_previous, H, differences, released = fields(state, r, k)
    z_new, z_before, guess_new, q_new, q_before, H_new, differences_new, held = fields(new, r, k)
    modes = len(series.swung)
    for j in range(modes):
        f, a = k - modes + j, reduced.follows[j]
        series.swung[j] = (1.0 - a) * (2.0 * q[f] - q_previous[f]) + reduced.gives[j] / a * reduced.force[f]
    if len(series.softness) > 0:
        warp_springs(series, reduced, q, springs, work)
    z_new[:] = z
    H_new[:] = H
    predictor = q_new  # read as q̂ while the step runs; φ(z) takes its place afterwards
    for j in range(k):
        predictor[j] = 2.0 * q[j] - q_previous[j]
    begin = guess if options.extrapolate else z
    for i in range(held.shape[0]):
        stiffness = math.sqrt(springs.stiffness[i // 3])
        for j in range(k):
            held[i, j] = stiffness * springs.B[i // 3, i % 3, j]
    exchange = Exchange(renew, others, held, released)
    result = step(reduced, springs, predictor, begin, z_new, H_new, exchange, options, work)
    z_before[:] = z
    extrapolate(z_previous, z, z_new, differences, differences_new, guess_new)
    for j in range(k):
        q_new[j] = work.q[j]
        q_before[j] = q[j]
    if modes > 0:
        swing_on(series, reduced, springs, q_new)
    return result


@njit(cache=True, nogil=True)
def extrapolate(earlier: Array, before: Array, z: Array, old: Array, new: Array, guess: Array) -> None:
    """Write the differences of z of order 2, 3, … and where the next step starts.

    The polynomial of order d through the last d + 1 states leads to z + Σ_{j ≤ d} ∇ʲz. At the last state the one of
    order d was wrong by ∇ᵈ⁺¹z, so the order is that of the least difference: a high one where the motion is smooth, a
    low one after a jolt.
    """
    r, order = len(z), 0
    least = 0.0
    for i in range(r):
        least += (z[i] - before[i]) ** 2
    for j in range(len(new)):
        size = 0.0
        for i in range(r):
            if j == 0:
                new[j, i] = (z[i] - before[i]) - (before[i] - earlier[i])
            else:
                new[j, i] = new[j - 1, i] - old[j - 1, i]
            size += new[j, i] ** 2
        if size < 0.5 * least:  # for after a jolt all are of one size
            least, order = size, j + 1
    for i in range(r):
        guess[i] = z[i]
        if order > 0:
            guess[i] += z[i] - before[i]
        for j in range(order - 1):
            guess[i] += new[j, i]
