"""Fixed corotated solid: Ψ = μ Σ (σᵢ − 1)² + λ/2 (J − 1)², finite for every F.

Source: Stomakhin, Howes, Schroeder and Teran 2012, "Energetically Consistent Invertible Elasticity", Eq. 4. The
stretches are signed: the smallest is negative where the solid is inverted.
"""

from __future__ import annotations

from ldsim.jit import njit
from ldsim.mechanics.materials.isotropic import isotropic
from ldsim.mechanics.materials.tensors import (
    Matrix,
    cofactor,
    combination,
    determinant,
    product_transposed,
    signed_svd,
)


@njit
def energy_stress(F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Ψ and P = 2μ (F − R) + λ (J − 1) cof F, with R = U Vᵀ the polar rotation."""
    U, (a, b, c), V = signed_svd(F)
    J = determinant(F)
    shear = combination(2.0 * mu, F, -2.0 * mu, product_transposed(U, V))
    P = combination(1.0, shear, lam * (J - 1.0), cofactor(F))
    return mu * ((a - 1.0) ** 2 + (b - 1.0) ** 2 + (c - 1.0) ** 2) + 0.5 * lam * (J - 1.0) ** 2, P


@njit(inline="always")
def slopes(x: float, y: float, z: float, I1: float, J: float, mu: float, lam: float) -> tuple[float, float, float]:
    pressure = lam * (J - 1.0)
    return 2.0 * mu * (x - 1.0) + pressure * y * z, 2.0 * mu + lam * (y * z) ** 2, (lam * J + pressure) * z


tangent = isotropic(slopes)
