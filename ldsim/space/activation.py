"""What stands between the layers of the decoder, compiled."""

from __future__ import annotations

import math

import numpy as np

from ldsim.arrays import Array
from ldsim.jit import kernel

ACTIVATIONS = {"elu": 0, "relu": 1, "tanh": 2, "sigmoid": 3}
LOG2_E = 1.0 / math.log(2.0)
# ln 2 in two parts, the first with so few bits that n times it is exact
LN_2, LN_2_REST = 6.93147180369123816490e-01, 1.90821492927058770002e-10
ROUNDER = 1.5 * 2.0**52


@kernel(fastmath={"contract", "nsz"})
def elu(x: Array) -> None:
    """x ← x where positive or NaN, else eˣ − 1, to 2 units in the last place; without a branch, for vectors.

    eˣ = 2ⁿ eᶠ with |f| ≤ ½ ln 2, eᶠ − 1 by its Taylor series; n is rounded by adding 1.5 · 2⁵², and 2ⁿ made from bits.
    """
    for i in range(x.shape[0]):
        v = x[i]
        y = v if v < 0.0 else 0.0
        y = y if y > -700.0 else -700.0
        shifted = y * LOG2_E + ROUNDER
        n = shifted - ROUNDER
        f = (y - n * LN_2) - n * LN_2_REST
        p = 1.0 / 6227020800.0
        p = p * f + 1.0 / 479001600.0
        p = p * f + 1.0 / 39916800.0
        p = p * f + 1.0 / 3628800.0
        p = p * f + 1.0 / 362880.0
        p = p * f + 1.0 / 40320.0
        p = p * f + 1.0 / 5040.0
        p = p * f + 1.0 / 720.0
        p = p * f + 1.0 / 120.0
        p = p * f + 1.0 / 24.0
        p = p * f + 1.0 / 6.0
        p = p * f + 0.5
        p = p * f * f + f
        power = np.int64((np.float64(shifted).view(np.int64) + np.int64(1023)) << np.int64(52)).view(np.float64)
        x[i] = power * p + (power - 1.0) if v <= 0.0 else v


@kernel()
def activate(kind: int, x: Array) -> None:
    """The activation of every entry, in place."""
    if kind == 0:
        elu(x)
        return
    for i in range(x.shape[0]):
        if kind == 1:
            x[i] = max(x[i], 0.0)
        elif kind == 2:
            x[i] = math.tanh(x[i])
        else:
            x[i] = 0.5 + 0.5 * math.tanh(0.5 * x[i])


@kernel()
def slope(kind: int, y: float) -> float:
    """Derivative of the activation in terms of its value y."""
    if kind == 0:
        return 1.0 if y > 0.0 else y + 1.0
    if kind == 1:
        return 1.0 if y > 0.0 else 0.0
    if kind == 2:
        return 1.0 - y * y
    return y * (1.0 - y)
