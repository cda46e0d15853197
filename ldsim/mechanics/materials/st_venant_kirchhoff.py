"""St. Venant–Kirchhoff solid: Ψ = μ E:E + λ/2 (tr E)² with E = (FᵀF − I)/2, finite for every F but weak in compression.

Source: Bonet and Wood 2008, "Nonlinear Continuum Mechanics for Finite Element Analysis", Sec. 6.3.
"""

from __future__ import annotations

from ldsim.jit import njit
from ldsim.mechanics.materials.isotropic import isotropic
from ldsim.mechanics.materials.tensors import Matrix, gram, product


@njit
def energy_stress(F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Ψ and P = F S with S = 2μ E + λ tr(E) I."""
    c00, c11, c22, c01, c02, c12 = gram(F)
    e00, e11, e22 = 0.5 * (c00 - 1.0), 0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0)
    trace = e00 + e11 + e22
    square = e00 * e00 + e11 * e11 + e22 * e22 + 0.5 * (c01 * c01 + c02 * c02 + c12 * c12)
    m, pressure = 2.0 * mu, lam * trace
    s01, s02, s12 = mu * c01, mu * c02, mu * c12
    S = (m * e00 + pressure, s01, s02, s01, m * e11 + pressure, s12, s02, s12, m * e22 + pressure)
    return mu * square + 0.5 * lam * trace * trace, product(F, S)


@njit(inline="always")
def slopes(x: float, y: float, z: float, I1: float, J: float, mu: float, lam: float) -> tuple[float, float, float]:
    """Of Ψ = μ/4 Σ (σᵢ² − 1)² + λ/8 (I₁ − 3)²."""
    pressure = 0.5 * lam * (I1 - 3.0)
    return (
        (mu * (x * x - 1.0) + pressure) * x,
        mu * (3.0 * x * x - 1.0) + pressure + lam * x * x,
        lam * x * y,
    )


tangent = isotropic(slopes)
