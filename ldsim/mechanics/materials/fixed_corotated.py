"""Fixed corotated solid: Ψ = μ Σ (σᵢ − 1)² + λ/2 (J − 1)², finite for every F.

Source: Stomakhin, Howes, Schroeder and Teran 2012, "Energetically Consistent Invertible Elasticity", Eq. 4. The
stretches are signed: the smallest is negative where the solid is inverted.
"""

from __future__ import annotations

from ldsim.jit import njit
from ldsim.mechanics.materials.tensors import Matrix, Principal, cofactor, determinant, signed_svd


@njit(cache=True)
def energy(F: Matrix, mu: float, lam: float) -> float:
    _, (a, b, c), _ = signed_svd(F)
    return mu * ((a - 1.0) ** 2 + (b - 1.0) ** 2 + (c - 1.0) ** 2) + 0.5 * lam * (determinant(F) - 1.0) ** 2


@njit(cache=True)
def energy_stress(F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Ψ and P = 2μ (F − R) + λ (J − 1) cof F, with R = U Vᵀ the polar rotation."""
    U, (a, b, c), V = signed_svd(F)
    J = determinant(F)
    pressure = lam * (J - 1.0)
    C = cofactor(F)
    P = (
        2.0 * mu * (F[0] - U[0] * V[0] - U[1] * V[1] - U[2] * V[2]) + pressure * C[0],
        2.0 * mu * (F[1] - U[0] * V[3] - U[1] * V[4] - U[2] * V[5]) + pressure * C[1],
        2.0 * mu * (F[2] - U[0] * V[6] - U[1] * V[7] - U[2] * V[8]) + pressure * C[2],
        2.0 * mu * (F[3] - U[3] * V[0] - U[4] * V[1] - U[5] * V[2]) + pressure * C[3],
        2.0 * mu * (F[4] - U[3] * V[3] - U[4] * V[4] - U[5] * V[5]) + pressure * C[4],
        2.0 * mu * (F[5] - U[3] * V[6] - U[4] * V[7] - U[5] * V[8]) + pressure * C[5],
        2.0 * mu * (F[6] - U[6] * V[0] - U[7] * V[1] - U[8] * V[2]) + pressure * C[6],
        2.0 * mu * (F[7] - U[6] * V[3] - U[7] * V[4] - U[8] * V[5]) + pressure * C[7],
        2.0 * mu * (F[8] - U[6] * V[6] - U[7] * V[7] - U[8] * V[8]) + pressure * C[8],
    )
    return mu * ((a - 1.0) ** 2 + (b - 1.0) ** 2 + (c - 1.0) ** 2) + 0.5 * lam * (J - 1.0) ** 2, P


@njit(cache=True, inline="always")
def principal(a: float, b: float, c: float, mu: float, lam: float) -> Principal:
    """First and second derivatives of Ψ in the principal stretches a, b, c."""
    J = a * b * c
    p = lam * (J - 1.0)
    return (
        2.0 * mu * (a - 1.0) + p * b * c,
        2.0 * mu * (b - 1.0) + p * a * c,
        2.0 * mu * (c - 1.0) + p * a * b,
        2.0 * mu + lam * (b * c) ** 2,
        2.0 * mu + lam * (a * c) ** 2,
        2.0 * mu + lam * (a * b) ** 2,
        (lam * J + p) * c,
        (lam * J + p) * b,
        (lam * J + p) * a,
    )
