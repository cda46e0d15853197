"""Stable neo-Hookean solid: Ψ = μ'/2 (I₁ − 3) + λ'/2 (J − α)² − μ'/2 log(I₁ + 1), finite for every F.

Source: Smith, de Goes and Kim 2018, "Stable Neo-Hookean Flesh Simulation", Eq. 14, with μ' = 4μ/3 and
λ' = λ + 5μ/6 (Sec. 3.4) so that it agrees with linear elasticity at rest, and α = 1 + 3μ'/4λ'.
Shifted by a constant so that Ψ(I) = 0.
"""

from __future__ import annotations

import math

from ldsim.jit import njit
from ldsim.mechanics.materials.tensors import Matrix, Principal, cofactor, combination, determinant, squared_norm


@njit(cache=True, inline="always")
def energy(F: Matrix, mu: float, lam: float) -> float:
    m, l = 4.0 * mu / 3.0, lam + 5.0 * mu / 6.0
    alpha = 1.0 + 0.75 * m / l
    I1 = squared_norm(F)
    J = determinant(F)
    at_rest = 0.5 * l * (1.0 - alpha) ** 2 - 0.5 * m * math.log(4.0)
    return 0.5 * m * (I1 - 3.0) + 0.5 * l * (J - alpha) ** 2 - 0.5 * m * math.log(I1 + 1.0) - at_rest


@njit(cache=True, inline="always")
def energy_stress(F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Ψ and P = μ' (1 − 1/(I₁ + 1)) F + λ' (J − α) cof F."""
    m, l = 4.0 * mu / 3.0, lam + 5.0 * mu / 6.0
    alpha = 1.0 + 0.75 * m / l
    I1 = squared_norm(F)
    J = determinant(F)
    shear = m * (1.0 - 1.0 / (I1 + 1.0))
    pressure = l * (J - alpha)
    P = combination(shear, F, pressure, cofactor(F))
    return energy(F, mu, lam), P


@njit(cache=True, inline="always")
def principal(a: float, b: float, c: float, mu: float, lam: float) -> Principal:
    """First and second derivatives of Ψ in the principal stretches a, b, c."""
    m, l = 4.0 * mu / 3.0, lam + 5.0 * mu / 6.0
    alpha = 1.0 + 0.75 * m / l
    J = a * b * c
    I1 = a * a + b * b + c * c
    shear = m * (1.0 - 1.0 / (I1 + 1.0))
    soft = 2.0 * m / (I1 + 1.0) ** 2
    p = l * (J - alpha)
    return (
        shear * a + p * b * c,
        shear * b + p * a * c,
        shear * c + p * a * b,
        shear + soft * a * a + l * (b * c) ** 2,
        shear + soft * b * b + l * (a * c) ** 2,
        shear + soft * c * c + l * (a * b) ** 2,
        soft * a * b + (l * J + p) * c,
        soft * a * c + (l * J + p) * b,
        soft * b * c + (l * J + p) * a,
    )
