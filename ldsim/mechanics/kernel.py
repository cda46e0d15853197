"""The decorator of every loop that a reduced step runs.

Numba counts the references to each array that a function is handed or takes a part of, and each count is an atomic
operation: a step had hundreds. Without its memory management nothing is counted, and what would allocate does not
compile. Assigning a whole array may allocate, so arrays are copied by `copy`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

Loop = TypeVar("Loop", bound=Callable[..., Any])


def kernel(**options: object) -> Callable[[Loop], Loop]:
    """Compile with numba, cached, without the interpreter's lock and without memory management.

    Args:
        options: more of numba's, such as fastmath.
    """
    every: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False, **options}
    return cast(Callable[[Loop], Loop], njit(**every))


@kernel()
def copy(source: NDArray[np.float64], target: NDArray[np.float64]) -> None:
    """target ← source, one-dimensional arrays of one length."""
    for i in range(target.shape[0]):
        target[i] = source[i]
