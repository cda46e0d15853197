"""Neo-Hookean solid of the paper's code: Ψ = μ/2 (J^(−2/3) tr FᵀF − 3) + λ/2 (J − 1)².

Infinite for J ≤ 0, so that a line search never enters an inverted state. Source: GAUSS, the library behind
Fulton et al. 2019, Sec. 6; the isochoric split is the standard one (Bonet and Wood 2008, Sec. 6.5).
"""

from __future__ import annotations

import math

from numba import njit

from ldsim.mechanics.materials.tensors import (
    Matrix,
    Principal,
    cofactor,
    combination,
    determinant,
    inverse_cube_root,
    squared_norm,
)


@njit(cache=True, inline="always")
def energy(F: Matrix, mu: float, lam: float) -> float:
    J = determinant(F)
    root = inverse_cube_root(J)
    density = 0.5 * mu * (root * root * squared_norm(F) - 3.0) + 0.5 * lam * (J - 1.0) ** 2
    return density if J > 0.0 else math.inf


@njit(cache=True, inline="always")
def energy_stress(F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Ψ and P = μ J^(−2/3) F + (λ (J − 1) − μ J^(−5/3) I₁ / 3) cof F; for J ≤ 0 P is of no meaning."""
    J = determinant(F)
    I1 = squared_norm(F)
    root = inverse_cube_root(J)
    shear = mu * root * root
    pressure = lam * (J - 1.0) - shear * I1 * (root * root * root) / 3.0
    P = combination(shear, F, pressure, cofactor(F))
    density = 0.5 * (shear * I1 - 3.0 * mu) + 0.5 * lam * (J - 1.0) ** 2
    return density if J > 0.0 else math.inf, P


@njit(cache=True, inline="always")
def principal(a: float, b: float, c: float, mu: float, lam: float) -> Principal:
    """First and second derivatives of Ψ in the principal stretches a, b, c."""
    J = a * b * c
    I1 = a * a + b * b + c * c
    shear = mu * abs(J) ** (-2.0 / 3.0)
    p = lam * (J - 1.0)
    t = shear * I1 / 3.0
    # ∂²/∂σᵢ²: shear (1/3 − …) collects to shear/3·(−1) + 5 I₁/(9 σᵢ²) of the isochoric part
    return (
        shear * a - t / a + p * b * c,
        shear * b - t / b + p * a * c,
        shear * c - t / c + p * a * b,
        -shear / 3.0 + 5.0 * t / (3.0 * a * a) + lam * (b * c) ** 2,
        -shear / 3.0 + 5.0 * t / (3.0 * b * b) + lam * (a * c) ** 2,
        -shear / 3.0 + 5.0 * t / (3.0 * c * c) + lam * (a * b) ** 2,
        -2.0 / 3.0 * shear * (a / b + b / a) + 2.0 * t / (3.0 * a * b) + (lam * J + p) * c,
        -2.0 / 3.0 * shear * (a / c + c / a) + 2.0 * t / (3.0 * a * c) + (lam * J + p) * b,
        -2.0 / 3.0 * shear * (b / c + c / b) + 2.0 * t / (3.0 * b * c) + (lam * J + p) * a,
    )
