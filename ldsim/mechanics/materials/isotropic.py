"""What follows from the slopes of an isotropic energy density: the tangent, and for Ψ(I₁, J) the stress as well.

Source: Smith, de Goes and Kim 2019, "Analytic Eigensystems for Isotropic Distortion Energies". A material calls one of
these factories; numba compiles what they return together with the material's own formulas, as if written out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ldsim.jit import njit
from ldsim.mechanics.materials.tensors import (
    Matrix,
    Symmetric,
    clamped_symmetric,
    cofactor,
    combination,
    determinant,
    signed_svd,
    squared_norm,
)

Compiled = Callable[..., Any]


def isotropic(slopes: Compiled) -> Compiled:
    """The tangent of a density that is a symmetric function of the signed principal stretches.

    Args:
        slopes: compiled, (x, y, z, I1, J, mu, lam) → ∂Ψ/∂x, ∂²Ψ/∂x², ∂²Ψ/∂x∂y at the stretches x, y, z in any order;
            I1 = x² + y² + z² and J = xyz are handed in because every order rounds them differently.
    """

    @njit(error_model="numpy")
    def tangent(F: Matrix, mu: float, lam: float, clamp: bool) -> tuple[Matrix, Matrix, Symmetric, Symmetric]:
        U, (p, q, r), V = signed_svd(F)
        I1, J = p * p + q * q + r * r, p * q * r
        # what a call returns and nobody takes is not computed
        d0, h00, h01 = slopes(p, q, r, I1, J, mu, lam)
        d1, h11, _ = slopes(q, p, r, I1, J, mu, lam)
        d2, h22, _ = slopes(r, p, q, I1, J, mu, lam)
        _, _, h02 = slopes(p, r, q, I1, J, mu, lam)
        _, _, h12 = slopes(q, r, p, I1, J, mu, lam)
        a01, b01 = _pair(p, q, d0, d1, 0.5 * (h00 + h11), h01, clamp)
        a02, b02 = _pair(p, r, d0, d2, 0.5 * (h00 + h22), h02, clamp)
        a12, b12 = _pair(q, r, d1, d2, 0.5 * (h11 + h22), h12, clamp)
        stretch = (h00, h11, h22, h01, h02, h12)
        if clamp:
            stretch = clamped_symmetric(stretch)
        return U, V, stretch, (a01, a02, a12, b01, b02, b12)

    return tangent


@njit(cache=True, inline="always")
def _pair(p: float, q: float, dp: float, dq: float, mean: float, mixed: float, clamp: bool) -> tuple[float, float]:
    """∂²Ψ/∂X_pq² and ∂²Ψ/∂X_pq∂X_qp of the off-diagonal pair, from its twist and flip eigenvalues.

    mean, mixed: of ∂²Ψ/∂p² and ∂²Ψ/∂q², and ∂²Ψ/∂p∂q. Where p and q meet, their difference is the limit of the flip's
    quotient; where p and −q meet, their sum is that of the twist's, if Ψ(−p, −q, r) = Ψ(p, q, r).
    """
    small = 1e-5 * (abs(p) + abs(q))
    total, limit = p + q, mean + mixed
    if abs(total) <= small and abs(dp + dq) <= 2.0 * abs(limit) * small:
        twist = limit
    else:
        # a density such as the corotated one has no tangent where p = −q; a steep finite one stands for it
        if abs(total) < 1e-8:
            total = 1e-8 if total >= 0.0 else -1e-8
        twist = (dp + dq) / total
    flip = (dp - dq) / (p - q) if abs(p - q) > small else mean - mixed
    if clamp:
        twist = max(twist, 0.0)
        flip = max(flip, 0.0)
    return 0.5 * (flip + twist), 0.5 * (flip - twist)


def of_invariants(density: Compiled, slopes: Compiled) -> tuple[Compiled, Compiled]:
    """`energy_stress` and `tangent` of Ψ = ψ(I₁, J), I₁ = tr FᵀF: P = 2 ψ₁ F + ψ_J cof F, the rest by the chain rule.

    Args:
        density: compiled, (I1, J, mu, lam) → ψ.
        slopes: compiled, (I1, J, mu, lam) → ψ₁, ψ_J, ψ₁₁, ψ₁_J, ψ_JJ.
    """

    @njit
    def energy_stress(F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
        I1, J = squared_norm(F), determinant(F)
        by_I1, by_J, _, _, _ = slopes(I1, J, mu, lam)
        return density(I1, J, mu, lam), combination(2.0 * by_I1, F, by_J, cofactor(F))

    @njit(inline="always")
    def stretched(
        x: float, y: float, z: float, I1: float, J: float, mu: float, lam: float
    ) -> tuple[float, float, float]:
        by_I1, by_J, twice_I1, mixed, twice_J = slopes(I1, J, mu, lam)
        area = y * z
        return (
            2.0 * by_I1 * x + by_J * area,
            2.0 * by_I1 + 4.0 * twice_I1 * x * x + 4.0 * mixed * x * area + twice_J * area * area,
            4.0 * twice_I1 * x * y + (2.0 * mixed * (x * x + y * y) + twice_J * J + by_J) * z,
        )

    return energy_stress, isotropic(stretched)
