"""Neo-Hookean solid of the paper's code: Ψ = μ/2 (J^(−2/3) tr FᵀF − 3) + λ/2 (J − 1)².

Infinite for J ≤ 0, so that a line search never enters an inverted state. Source: GAUSS, the library behind
Fulton et al. 2019, Sec. 6; the isochoric split is the standard one (Bonet and Wood 2008, Sec. 6.5).
"""

from __future__ import annotations

import math

from ldsim.jit import njit
from ldsim.mechanics.materials.isotropic import isotropic
from ldsim.mechanics.materials.tensors import (
    Matrix,
    cofactor,
    combination,
    determinant,
    inverse_cube_root,
    squared_norm,
)


@njit(inline="always")
def _invariants(F: Matrix) -> tuple[float, float, float, float]:
    """I₁ = tr FᵀF, J − 1, J^(−1/3) and J^(−2/3) I₁ − 3, the second and last without cancellation near rest.

    With H = F − I: I₁ − 3 = 2 tr H + |H|², J − 1 = tr H + ½ ((tr H)² − tr H²) + det H, and for y = J^(−1/3)
    y − 1 = −(J − 1) y³ / (1 + y + y²).
    """
    a, b, c = F[0] - 1.0, F[4] - 1.0, F[8] - 1.0
    trace = a + b + c
    stretch = 2.0 * trace + squared_norm((a, F[1], F[2], F[3], b, F[5], F[6], F[7], c))
    minors = (a * b - F[1] * F[3]) + (a * c - F[2] * F[6]) + (b * c - F[5] * F[7])
    volume = trace + minors + determinant((a, F[1], F[2], F[3], b, F[5], F[6], F[7], c))
    y = inverse_cube_root(1.0 + volume)
    less_one = -volume * (y * y * y) / (1.0 + y + y * y)
    return 3.0 + stretch, volume, y, 3.0 * (y + 1.0) * less_one + y * y * stretch


@njit
def energy_stress(F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Ψ and P = μ J^(−2/3) F + (λ (J − 1) − μ J^(−5/3) I₁ / 3) cof F; for J ≤ 0 P is of no meaning."""
    I1, volume, y, shape = _invariants(F)
    shear = mu * y * y
    pressure = lam * volume - shear * I1 * (y * y * y) / 3.0
    P = combination(shear, F, pressure, cofactor(F))
    return 0.5 * mu * shape + 0.5 * lam * volume * volume if volume > -1.0 else math.inf, P


@njit(inline="always")
def slopes(x: float, y: float, z: float, I1: float, J: float, mu: float, lam: float) -> tuple[float, float, float]:
    # |J|, so that the tangent is finite where a line search looks at an inverted state
    shear = mu * abs(J) ** (-2.0 / 3.0)
    pressure = lam * (J - 1.0)
    t = shear * I1 / 3.0
    return (
        shear * x - t / x + pressure * y * z,
        -shear / 3.0 + 5.0 * t / (3.0 * x * x) + lam * (y * z) ** 2,
        -2.0 / 3.0 * shear * (x / y + y / x) + 2.0 * t / (3.0 * x * y) + (lam * J + pressure) * z,
    )


tangent = isotropic(slopes)
