"""Stable neo-Hookean solid: Ψ = μ'/2 (I₁ − 3) + λ'/2 (J − α)² − μ'/2 log(I₁ + 1), finite for every F.

Source: Smith, de Goes and Kim 2018, "Stable Neo-Hookean Flesh Simulation", Eq. 14, with μ' = 4μ/3 and
λ' = λ + 5μ/6 (Sec. 3.4) so that it agrees with linear elasticity at rest, and α = 1 + 3μ'/4λ'.
Shifted by a constant so that Ψ(I) = 0.
"""

from __future__ import annotations

import math

from ldsim.jit import njit
from ldsim.mechanics.materials.isotropic import of_invariants


@njit(inline="always")
def density(I1: float, J: float, mu: float, lam: float) -> float:
    m, l = 4.0 * mu / 3.0, lam + 5.0 * mu / 6.0
    alpha = 1.0 + 0.75 * m / l
    # written as differences from rest, where the terms themselves are large against what is left of them
    volumetric = (J - alpha) ** 2 - (1.0 - alpha) ** 2
    return 0.5 * m * (I1 - 3.0 - math.log((I1 + 1.0) / 4.0)) + 0.5 * l * volumetric


@njit(inline="always")
def slopes(I1: float, J: float, mu: float, lam: float) -> tuple[float, float, float, float, float]:
    m, l = 4.0 * mu / 3.0, lam + 5.0 * mu / 6.0
    alpha = 1.0 + 0.75 * m / l
    return 0.5 * m * (1.0 - 1.0 / (I1 + 1.0)), l * (J - alpha), 0.5 * m / (I1 + 1.0) ** 2, 0.0, l


energy_stress, tangent = of_invariants(density, slopes)
