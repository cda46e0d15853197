"""One call from state to state: all that a step reads is handed to compiled code by two references.

Passing the arrays themselves costs half a microsecond each, and a model has fifty: more than the step computes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numba.core import types
from numba.experimental import structref
from numpy.typing import NDArray

from ldsim.dynamics.reduced import Options, step
from ldsim.dynamics.reduced_potential import Reduced, Springs, Work

Array = NDArray[np.float64]


@structref.register
class _Reference(types.StructRef):
    """The compiled side of `Model` and `Held`."""

    def preprocess_fields(self, fields: tuple[tuple[str, types.Type], ...]) -> tuple[tuple[str, types.Type], ...]:
        return tuple((name, types.unliteral(kind)) for name, kind in fields)  # type: ignore[no-untyped-call]


class Reference(structref.StructRefProxy):
    """Named tuples of arrays behind one reference; the arrays are shared, the numbers copied."""

    content: Any

    def __new__(cls, content: tuple[object, ...]) -> Reference:
        made: Reference = structref.StructRefProxy.__new__(cls, content)  # type: ignore[no-untyped-call]
        return made


structref.define_proxy(Reference, _Reference, ["content"])  # type: ignore[no-untyped-call]


def model_reference(model: Reduced, options: Options, work: Work) -> Reference:
    """What stays from step to step."""
    return Reference((model, options, work))


def springs_reference(springs: Springs) -> Reference:
    """The grabs; their targets and stiffnesses may be changed in place."""
    return Reference((springs,))


@njit(cache=True, nogil=True)
def advance(
    model: Reference,
    springs: Reference,
    z: Array,
    z_previous: Array,
    q: Array,
    q_previous: Array,
    guess: Array,
    H: Array,
    renew: bool,
    new: Array,
) -> tuple[int, int, int, float, float]:
    """One step of implicit Euler from two frames; see `reduced.step` for what is returned.

    Args:
        z, z_previous, q, q_previous, guess, H: fields of a `ReducedState`; left as they are.
        new: z, the next guess by quadratic extrapolation, q and H of the new state, one after the other,
            (2r + k + r²,), overwritten.
    """
    reduced, options, work = model.content
    r, k = z.shape[0], q.shape[0]
    z_new, guess_new, q_new = new[:r], new[r : 2 * r], new[2 * r : 2 * r + k]
    H_new = new[2 * r + k :].reshape(r, r)
    z_new[:] = z
    H_new[:] = H
    for j in range(k):
        q_new[j] = 2.0 * q[j] - q_previous[j]
    result = step(reduced, springs.content[0], q_new, guess, z_new, H_new, renew, options, work)
    q_new[:] = work.q
    for i in range(r):
        guess_new[i] = z_new[i] + 2.0 * (z_new[i] - z[i]) - (z[i] - z_previous[i])
    return result
