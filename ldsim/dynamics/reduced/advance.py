"""One call from state to state: all that a step reads is handed to compiled code by one reference.

Passing the arrays themselves costs half a microsecond each, and a model has fifty: more than the step computes. A
reference costs two.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.core import types
from numba.experimental import structref
from numpy.typing import NDArray

from ldsim.dynamics.reduced.minimiser import Options, step
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work
from ldsim.jit import njit

Array = NDArray[np.float64]


@structref.register
class _Reference(types.StructRef):
    """The compiled side of `Reference`."""

    def preprocess_fields(self, fields: tuple[tuple[str, types.Type], ...]) -> tuple[tuple[str, types.Type], ...]:
        return tuple((name, types.unliteral(kind)) for name, kind in fields)  # type: ignore[no-untyped-call]


class Reference(structref.StructRefProxy):
    """Named tuples of arrays behind one reference; the arrays are shared, the numbers copied."""

    content: Any

    def __new__(cls, content: tuple[object, ...]) -> Reference:
        made: Reference = structref.StructRefProxy.__new__(cls, content)  # type: ignore[no-untyped-call]
        return made


structref.define_proxy(Reference, _Reference, ["content"])  # type: ignore[no-untyped-call]


def step_reference(model: Reduced, springs: Springs, options: Options, work: Work) -> Reference:
    """What stays from step to step; targets and stiffnesses of the grabs may be changed in place."""
    return Reference((model, springs, options, work))


@njit(cache=True, nogil=True)
def advance(
    reference: Reference,
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
    q, H = 3 * r, 3 * r + 2 * k
    new[:r] = state[:r]
    new[H:] = state[H:]
    predictor = new[q : q + k]
    for j in range(k):
        predictor[j] = 2.0 * state[q + j] - state[q + k + j]
    H_new = new[H:].reshape(r, r)
    result = step(reduced, springs, predictor, state[2 * r : q], new[:r], H_new, renew, options, work)
    for i in range(r):
        new[r + i] = state[i]
        new[2 * r + i] = new[i] + 2.0 * (new[i] - state[i]) - (state[i] - state[r + i])
    for j in range(k):
        new[q + j] = work.q[j]
        new[q + k + j] = state[q + j]
    return result
