"""Linear elasticity: Ψ = μ ε:ε + λ/2 (tr ε)² with ε = (F + Fᵀ)/2 − I, for strains and rotations of a few per cent.

Not frame indifferent: a rotation costs energy. Source: Bonet and Wood 2008, Sec. 6.3, linearised.
"""

from __future__ import annotations

from ldsim.jit import njit
from ldsim.mechanics.materials.tensors import IDENTITY, Matrix, Symmetric


@njit
def energy_stress(F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Ψ and P = 2μ ε + λ tr(ε) I."""
    e00, e11, e22 = F[0] - 1.0, F[4] - 1.0, F[8] - 1.0
    e01, e02, e12 = 0.5 * (F[1] + F[3]), 0.5 * (F[2] + F[6]), 0.5 * (F[5] + F[7])
    trace = e00 + e11 + e22
    m, pressure = 2.0 * mu, lam * trace
    square = e00 * e00 + e11 * e11 + e22 * e22 + 2.0 * (e01 * e01 + e02 * e02 + e12 * e12)
    P = (
        m * e00 + pressure, m * e01, m * e02,
        m * e01, m * e11 + pressure, m * e12,
        m * e02, m * e12, m * e22 + pressure,
    )  # fmt: skip
    return mu * square + 0.5 * lam * trace * trace, P


@njit
def tangent(F: Matrix, mu: float, lam: float, clamp: bool) -> tuple[Matrix, Matrix, Symmetric, Symmetric]:
    """Constant, and never negative: no function of the stretches, so it stands in the frame of the axes."""
    stiff = 2.0 * mu + lam
    return IDENTITY, IDENTITY, (stiff, stiff, stiff, lam, lam, lam), (mu, mu, mu, mu, mu, mu)
