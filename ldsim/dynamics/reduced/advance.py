"""One call from state to state: all that a step reads is handed to compiled code by one reference.

Passing the arrays themselves costs half a microsecond each, and a model has fifty: more than the step computes. A
reference costs two.
"""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.experimental import structref

from ldsim.arrays import Array
from ldsim.dynamics.reduced.minimiser import Minimisation, step
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work
from ldsim.dynamics.reduced.state import fields
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


def step_reference(model: Reduced, springs: Springs, options: Minimisation, work: Work) -> StepReference:
    """What stays from step to step; targets and stiffnesses of the grabs may be changed in place."""
    return StepReference((model, springs, options, work))


@njit(cache=True, nogil=True)
def advance(
    reference: StepReference,
    state: Array,
    renew: bool,
    new: Array,
) -> tuple[int, int, int, float, float]:
    """One step of implicit Euler; see `reduced.step` for what is returned.

    Args:
        state: `ReducedState.data`; left as it is.
        new: that of the new state, its guess by quadratic extrapolation; overwritten.
    """
    reduced, springs, options, work = reference.content
    r, k = work.g.shape[0], work.q.shape[0]
    z, z_previous, guess, q, q_previous, H = fields(state, r, k)
    z_new, z_before, guess_new, q_new, q_before, H_new = fields(new, r, k)
    z_new[:] = z
    H_new[:] = H
    predictor = q_new  # read as q̂ while the step runs; φ(z) takes its place afterwards
    for j in range(k):
        predictor[j] = 2.0 * q[j] - q_previous[j]
    begin = guess if options.extrapolate else z
    result = step(reduced, springs, predictor, begin, z_new, H_new, renew, options, work)
    for i in range(r):
        z_before[i] = z[i]
        # quadratic extrapolation: the change of the last step, plus the change of that change
        guess_new[i] = z_new[i] + 2.0 * (z_new[i] - z[i]) - (z[i] - z_previous[i])
    for j in range(k):
        q_new[j] = work.q[j]
        q_before[j] = q[j]
    return result
