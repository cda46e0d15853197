"""What a step runs is compiled without memory management."""

from __future__ import annotations

import numpy as np
import pytest
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from ldsim.jit import copy, kernel


def test_what_allocates_does_not_compile() -> None:
    @kernel(cache=False)
    def twice_the_first(x: NDArray[np.float64]) -> float:
        return float((x + x)[0])

    with pytest.raises(NumbaError, match="NRT required but not enabled"):
        twice_the_first(np.ones(3))


def test_arrays_and_parts_of_them_are_read_and_written() -> None:
    @kernel(cache=False)
    def double_tail(x: NDArray[np.float64]) -> None:
        tail = x[1:]
        for i in range(tail.shape[0]):
            tail[i] *= 2.0

    x, y = np.arange(4.0), np.zeros(4)
    double_tail(x)
    copy(x, y)
    np.testing.assert_array_equal(y, [0.0, 2.0, 4.0, 6.0])
