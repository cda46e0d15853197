"""Linear elasticity: Ψ = μ ε:ε + λ/2 (tr ε)² with ε = (F + Fᵀ)/2 − I, for strains and rotations of a few per cent.

Not frame indifferent: a rotation costs energy. Its tangent is constant and no function of the stretches, so `tangent`
in this package has a branch of its own for it. Source: Bonet and Wood 2008, Sec. 6.3, linearised.
"""

from __future__ import annotations

from ldsim.jit import njit
from ldsim.mechanics.materials.tensors import Matrix, Principal


@njit(cache=True, inline="always")
def energy(F: Matrix, mu: float, lam: float) -> float:
    e00, e11, e22 = F[0] - 1.0, F[4] - 1.0, F[8] - 1.0
    e01, e02, e12 = 0.5 * (F[1] + F[3]), 0.5 * (F[2] + F[6]), 0.5 * (F[5] + F[7])
    square = e00 * e00 + e11 * e11 + e22 * e22 + 2.0 * (e01 * e01 + e02 * e02 + e12 * e12)
    return mu * square + 0.5 * lam * (e00 + e11 + e22) ** 2


@njit(cache=True, inline="always")
def energy_stress(F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Ψ and P = 2μ ε + λ tr(ε) I."""
    pressure = lam * (F[0] + F[4] + F[8] - 3.0)
    p01, p02, p12 = mu * (F[1] + F[3]), mu * (F[2] + F[6]), mu * (F[5] + F[7])
    P = (
        2.0 * mu * (F[0] - 1.0) + pressure,
        p01,
        p02,
        p01,
        2.0 * mu * (F[4] - 1.0) + pressure,
        p12,
        p02,
        p12,
        2.0 * mu * (F[8] - 1.0) + pressure,
    )
    return energy(F, mu, lam), P


@njit(cache=True, inline="always")
def principal(a: float, b: float, c: float, mu: float, lam: float) -> Principal:
    """First and second derivatives of Ψ in a, b, c for F = diag(a, b, c)."""
    pressure = lam * (a + b + c - 3.0)
    stiff = 2.0 * mu + lam
    return (
        2.0 * mu * (a - 1.0) + pressure,
        2.0 * mu * (b - 1.0) + pressure,
        2.0 * mu * (c - 1.0) + pressure,
        stiff,
        stiff,
        stiff,
        lam,
        lam,
        lam,
    )
