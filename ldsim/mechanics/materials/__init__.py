"""Hyperelastic materials as compiled functions of the deformation gradient, chosen per point by a number.

A material is one file with three functions: `energy` Ψ(F), `energy_stress` (Ψ, P) and `principal`, the derivatives of
Ψ in the principal stretches, from which the tangent follows for every isotropic material (Smith, de Goes and
Kim 2019, "Analytic Eigensystems for Isotropic Distortion Energies"). It is added here in `MATERIALS`, in the branches
below and as a sum over points, and is tested by being listed.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ldsim.jit import kernel, njit
from ldsim.mechanics.materials import fixed_corotated, linear, neo_hookean, st_venant_kirchhoff, stable_neo_hookean
from ldsim.mechanics.materials.tensors import (
    Matrix,
    Principal,
    Symmetric,
    clamped_symmetric,
    signed_svd,
)

Array = NDArray[np.float64]
Number = TypeVar("Number", float, NDArray[np.float64])

MATERIALS = {"neo_hookean": 0, "stable_neo_hookean": 1, "st_venant_kirchhoff": 2, "fixed_corotated": 3, "linear": 4}
LINEAR = MATERIALS["linear"]
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

_energy_neo_hookean, _stress_neo_hookean = neo_hookean.energy, neo_hookean.energy_stress
_energy_stable, _stress_stable = stable_neo_hookean.energy, stable_neo_hookean.energy_stress
_energy_kirchhoff, _stress_kirchhoff = st_venant_kirchhoff.energy, st_venant_kirchhoff.energy_stress
_energy_corotated, _stress_corotated = fixed_corotated.energy, fixed_corotated.energy_stress
_energy_linear, _stress_linear = linear.energy, linear.energy_stress
_principal_neo_hookean, _principal_stable = neo_hookean.principal, stable_neo_hookean.principal
_principal_kirchhoff, _principal_corotated = st_venant_kirchhoff.principal, fixed_corotated.principal
_principal_linear = linear.principal


@njit(cache=True)
def energy(kind: int, F: Matrix, mu: float, lam: float) -> float:
    """Energy density Ψ(F), J/m³, of material number `kind` with Lamé parameters mu, lam, Pa."""
    if kind == 0:
        return _energy_neo_hookean(F, mu, lam)
    if kind == 1:
        return _energy_stable(F, mu, lam)
    if kind == 2:
        return _energy_kirchhoff(F, mu, lam)
    if kind == 3:
        return _energy_corotated(F, mu, lam)
    return _energy_linear(F, mu, lam)


@njit(cache=True)
def energy_stress(kind: int, F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Energy density Ψ(F), J/m³, and the first Piola–Kirchhoff stress P = ∂Ψ/∂F, Pa."""
    if kind == 0:
        return _stress_neo_hookean(F, mu, lam)
    if kind == 1:
        return _stress_stable(F, mu, lam)
    if kind == 2:
        return _stress_kirchhoff(F, mu, lam)
    if kind == 3:
        return _stress_corotated(F, mu, lam)
    return _stress_linear(F, mu, lam)


@njit(cache=True, inline="always")
def deformation(strain: Array, s: int) -> Matrix:
    """F = I + strain of point s; strain is (9, c)."""
    return (
        1.0 + strain[0, s],
        strain[1, s],
        strain[2, s],
        strain[3, s],
        1.0 + strain[4, s],
        strain[5, s],
        strain[6, s],
        strain[7, s],
        1.0 + strain[8, s],
    )


@njit(cache=True, inline="always")
def _put(P: Matrix, w: float, out: Array, s: int) -> None:
    out[0, s], out[1, s], out[2, s] = w * P[0], w * P[1], w * P[2]
    out[3, s], out[4, s], out[5, s] = w * P[3], w * P[4], w * P[5]
    out[6, s], out[7, s], out[8, s] = w * P[6], w * P[7], w * P[8]


# One function for each material and indices from 0: a common loop, or a start other than 0, takes twice the time.
REASSOCIATE = {"reassoc", "contract", "nsz"}


@kernel(error_model="numpy", fastmath=REASSOCIATE)
def _sum_neo_hookean(strain: Array, weights: Array, mu: Array, lam: Array) -> float:
    total = 0.0
    for s in range(strain.shape[1]):
        density, P = _stress_neo_hookean(deformation(strain, s), mu[s], lam[s])
        total += weights[s] * density
        _put(P, weights[s], strain, s)
    return total


@kernel(error_model="numpy", fastmath=REASSOCIATE)
def _sum_stable(strain: Array, weights: Array, mu: Array, lam: Array) -> float:
    total = 0.0
    for s in range(strain.shape[1]):
        density, P = _stress_stable(deformation(strain, s), mu[s], lam[s])
        total += weights[s] * density
        _put(P, weights[s], strain, s)
    return total


@kernel(error_model="numpy", fastmath=REASSOCIATE)
def _sum_kirchhoff(strain: Array, weights: Array, mu: Array, lam: Array) -> float:
    total = 0.0
    for s in range(strain.shape[1]):
        density, P = _stress_kirchhoff(deformation(strain, s), mu[s], lam[s])
        total += weights[s] * density
        _put(P, weights[s], strain, s)
    return total


@kernel(error_model="numpy", fastmath=REASSOCIATE)
def _sum_corotated(strain: Array, weights: Array, mu: Array, lam: Array) -> float:
    total = 0.0
    for s in range(strain.shape[1]):
        density, P = _stress_corotated(deformation(strain, s), mu[s], lam[s])
        total += weights[s] * density
        _put(P, weights[s], strain, s)
    return total


@kernel(error_model="numpy", fastmath=REASSOCIATE)
def _sum_linear(strain: Array, weights: Array, mu: Array, lam: Array) -> float:
    total = 0.0
    for s in range(strain.shape[1]):
        density, P = _stress_linear(deformation(strain, s), mu[s], lam[s])
        total += weights[s] * density
        _put(P, weights[s], strain, s)
    return total


@kernel(error_model="numpy", fastmath=REASSOCIATE)
def _sum_mixed(kind: NDArray[np.int8], strain: Array, weights: Array, mu: Array, lam: Array) -> float:
    total = 0.0
    for s in range(strain.shape[1]):
        density, P = energy_stress(kind[s], deformation(strain, s), mu[s], lam[s])
        total += weights[s] * density
        _put(P, weights[s], strain, s)
    return total


@kernel()
def weighted_stresses(kind: NDArray[np.int8], strain: Array, weights: Array, mu: Array, lam: Array) -> float:
    """Σ w Ψ(I + strain), J, of c points; `strain` (9, c) is overwritten by w P. Infinite where one density is."""
    first, mixed = kind[0] if kind.shape[0] else 0, False
    for s in range(kind.shape[0]):
        mixed |= kind[s] != first
    if mixed:
        total = _sum_mixed(kind, strain, weights, mu, lam)
    elif first == 0:
        total = _sum_neo_hookean(strain, weights, mu, lam)
    elif first == 1:
        total = _sum_stable(strain, weights, mu, lam)
    elif first == 2:
        total = _sum_kirchhoff(strain, weights, mu, lam)
    elif first == 3:
        total = _sum_corotated(strain, weights, mu, lam)
    else:
        total = _sum_linear(strain, weights, mu, lam)
    return total if total < math.inf else math.inf


@njit(cache=True)
def principal(kind: int, a: float, b: float, c: float, mu: float, lam: float) -> Principal:
    """∂Ψ/∂σ (3 values) and ∂²Ψ/∂σ² (00, 11, 22, 01, 02, 12) at the stretches a, b, c, Pa."""
    if kind == 0:
        return _principal_neo_hookean(a, b, c, mu, lam)
    if kind == 1:
        return _principal_stable(a, b, c, mu, lam)
    if kind == 2:
        return _principal_kirchhoff(a, b, c, mu, lam)
    if kind == 3:
        return _principal_corotated(a, b, c, mu, lam)
    return _principal_linear(a, b, c, mu, lam)


@njit(cache=True, inline="always")
def _pair(
    p: float, q: float, dp: float, dq: float, hpp: float, hqq: float, hpq: float, clamp: bool
) -> tuple[float, float]:
    """∂²Ψ/∂X_pq² and ∂²Ψ/∂X_pq∂X_qp of the off-diagonal pair, from its twist and flip eigenvalues."""
    total = p + q
    if abs(total) < 1e-8:
        total = 1e-8 if total >= 0.0 else -1e-8
    twist = (dp + dq) / total
    if abs(p - q) > 1e-5 * (abs(p) + abs(q)):
        flip = (dp - dq) / (p - q)
    else:
        flip = 0.5 * (hpp + hqq) - hpq
    if clamp:
        twist = max(twist, 0.0)
        flip = max(flip, 0.0)
    return 0.5 * (flip + twist), 0.5 * (flip - twist)


@njit(cache=True)
def tangent(kind: int, F: Matrix, mu: float, lam: float, clamp: bool) -> tuple[Matrix, Matrix, Symmetric, Symmetric]:
    """The tangent ∂²Ψ/∂F² in the frame of the singular vectors, X = Uᵀ dF V.

    Returns U, V, the stretch block ∂²Ψ/∂X_ii∂X_jj as (00, 11, 22, 01, 02, 12), and the three off-diagonal pairs as
    (a01, a02, a12, b01, b02, b12): a_ij = ∂²Ψ/∂X_ij² = ∂²Ψ/∂X_ji², b_ij = ∂²Ψ/∂X_ij∂X_ji; everything else is zero.
    With `clamp`, negative eigenvalues are set to zero (Smith et al. 2019, Sec. 5).
    """
    if kind == LINEAR:
        stiff = 2.0 * mu + lam
        return IDENTITY, IDENTITY, (stiff, stiff, stiff, lam, lam, lam), (mu, mu, mu, mu, mu, mu)
    U, (p, q, r), V = signed_svd(F)
    d0, d1, d2, h00, h11, h22, h01, h02, h12 = principal(kind, p, q, r, mu, lam)
    a01, b01 = _pair(p, q, d0, d1, h00, h11, h01, clamp)
    a02, b02 = _pair(p, r, d0, d2, h00, h22, h02, clamp)
    a12, b12 = _pair(q, r, d1, d2, h11, h22, h12, clamp)
    stretch = (h00, h11, h22, h01, h02, h12)
    if clamp:
        stretch = clamped_symmetric(stretch)
    return U, V, stretch, (a01, a02, a12, b01, b02, b12)


def lame_parameters(youngs_modulus: Number, poisson_ratio: Number) -> tuple[Number, Number]:
    """μ = E / 2(1 + ν) and λ = E ν / (1 + ν)(1 − 2ν), Pa; of one material, or of each entry of two arrays."""
    mu = youngs_modulus / (2 * (1 + poisson_ratio))
    lam = youngs_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    return mu, lam
