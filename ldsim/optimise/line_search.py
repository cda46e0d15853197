"""Which step along a direction is taken and which is tried next: one rule for full, reduced and batched minimisers.

The batched one (dynamics/batched/newton.py) needs it on tensors, where a branch is a choice between two values for
each instance; it has these numbers, and a test compares the two.
"""

from __future__ import annotations

import math

from ldsim.jit import kernel

ARMIJO = 1e-4
# Values closer than this share are told apart by their slopes: the potential is a sum of large terms that cancel.
ROUNDOFF = 1e-10
MAX_BACKTRACKS = 40
EPSILON = 2.0**-52
# Among values that differ only by rounding, shares of the first slope: the least it must have risen to, the most after.
RISEN, FALLEN = 0.9, 0.8
# The next step as a share of this one: at least, at most where the values tell, where the slopes do, after infinity.
SHORTEST, HALF, LONGEST, AFTER_INFINITE = 0.1, 0.5, 10.0, 0.25


@kernel()
def accepts(f0: float, slope0: float, step: float, f: float, slope: float) -> bool:
    """Sufficient decrease, or its form in the slopes where the values differ only by rounding.

    Armijo: f ≤ f₀ + c₁ α φ'(0). While |f − f₀| is at the level of rounding, φ'(α) ≤ (2c − 1) φ'(0) with c = 0.1 instead
    (Hager and Zhang 2005, Eq. 4.1), and the slope has risen from φ'(0) by a tenth or more, so that steps of
    rounding size are not accepted without end.
    """
    if not f < math.inf:
        return False
    if abs(f - f0) <= ROUNDOFF * abs(f0):
        return RISEN * slope0 <= slope <= -FALLEN * slope0
    return f <= f0 + ARMIJO * step * slope0


@kernel()
def next_step(f0: float, slope0: float, step: float, f: float, slope: float) -> float:
    """The step to try after one that was not accepted.

    Where the values tell, the minimiser of the parabola through f₀, φ'(0) and f, kept within a tenth and a half of the
    step; where they differ only by rounding, the root of the secant through both slopes, at most ten times the step.
    """
    if not f < math.inf:
        return AFTER_INFINITE * step
    if abs(f - f0) <= ROUNDOFF * abs(f0):
        return (
            step * min(max(slope0 / min(slope0 - slope, -1e-300), SHORTEST), LONGEST)
            if slope > slope0
            else LONGEST * step
        )
    curvature = f - f0 - slope0 * step
    if curvature <= 0.0:
        return HALF * step
    return min(max(-0.5 * slope0 * step * step / curvature, SHORTEST * step), HALF * step)
