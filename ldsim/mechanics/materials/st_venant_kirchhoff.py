"""St. Venant–Kirchhoff solid: Ψ = μ E:E + λ/2 (tr E)² with E = (FᵀF − I)/2, finite for every F but weak in compression.

Source: Bonet and Wood 2008, "Nonlinear Continuum Mechanics for Finite Element Analysis", Sec. 6.3.
"""

from __future__ import annotations

from ldsim.jit import njit
from ldsim.mechanics.materials.tensors import Matrix, Principal, Symmetric


@njit(cache=True, inline="always")
def green_strain(F: Matrix) -> Symmetric:
    """E = (FᵀF − I)/2 as (00, 11, 22, 01, 02, 12)."""
    return (
        0.5 * (F[0] * F[0] + F[3] * F[3] + F[6] * F[6] - 1.0),
        0.5 * (F[1] * F[1] + F[4] * F[4] + F[7] * F[7] - 1.0),
        0.5 * (F[2] * F[2] + F[5] * F[5] + F[8] * F[8] - 1.0),
        0.5 * (F[0] * F[1] + F[3] * F[4] + F[6] * F[7]),
        0.5 * (F[0] * F[2] + F[3] * F[5] + F[6] * F[8]),
        0.5 * (F[1] * F[2] + F[4] * F[5] + F[7] * F[8]),
    )


@njit(cache=True, inline="always")
def energy(F: Matrix, mu: float, lam: float) -> float:
    E = green_strain(F)
    trace = E[0] + E[1] + E[2]
    square = E[0] * E[0] + E[1] * E[1] + E[2] * E[2] + 2.0 * (E[3] * E[3] + E[4] * E[4] + E[5] * E[5])
    return mu * square + 0.5 * lam * trace * trace


@njit(cache=True, inline="always")
def energy_stress(F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Ψ and P = F S with S = 2μ E + λ tr(E) I."""
    E = green_strain(F)
    pressure = lam * (E[0] + E[1] + E[2])
    s00, s11, s22 = 2.0 * mu * E[0] + pressure, 2.0 * mu * E[1] + pressure, 2.0 * mu * E[2] + pressure
    s01, s02, s12 = 2.0 * mu * E[3], 2.0 * mu * E[4], 2.0 * mu * E[5]
    P = (
        F[0] * s00 + F[1] * s01 + F[2] * s02,
        F[0] * s01 + F[1] * s11 + F[2] * s12,
        F[0] * s02 + F[1] * s12 + F[2] * s22,
        F[3] * s00 + F[4] * s01 + F[5] * s02,
        F[3] * s01 + F[4] * s11 + F[5] * s12,
        F[3] * s02 + F[4] * s12 + F[5] * s22,
        F[6] * s00 + F[7] * s01 + F[8] * s02,
        F[6] * s01 + F[7] * s11 + F[8] * s12,
        F[6] * s02 + F[7] * s12 + F[8] * s22,
    )
    return energy(F, mu, lam), P


@njit(cache=True, inline="always")
def principal(a: float, b: float, c: float, mu: float, lam: float) -> Principal:
    """First and second derivatives of Ψ = μ/4 Σ (σᵢ² − 1)² + λ/8 (Σ σᵢ² − 3)² in the principal stretches a, b, c."""
    pressure = 0.5 * lam * (a * a + b * b + c * c - 3.0)
    return (
        (mu * (a * a - 1.0) + pressure) * a,
        (mu * (b * b - 1.0) + pressure) * b,
        (mu * (c * c - 1.0) + pressure) * c,
        mu * (3.0 * a * a - 1.0) + pressure + lam * a * a,
        mu * (3.0 * b * b - 1.0) + pressure + lam * b * b,
        mu * (3.0 * c * c - 1.0) + pressure + lam * c * c,
        lam * a * b,
        lam * a * c,
        lam * b * c,
    )
