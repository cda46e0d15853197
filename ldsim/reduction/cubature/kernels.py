"""The compiled loops of cubature that the mechanics does not have."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ldsim.mechanics.elastic import Elements, deformation_gradient
from ldsim.mechanics.materials import energy, energy_stress, tangent
from ldsim.mechanics.materials.tensors import Matrix

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def add_point_powers(elements: Elements, stresses: NDArray[np.floating], y: Array, powers: Array) -> None:
    """Adds w_s P_s : Σ_a y_a ⊗ ∇N_a to `powers` (s,); stresses (s, 9) Pa, field y (n, 3)."""
    for s in range(elements.weights.shape[0]):
        p00, p01, p02 = stresses[s, 0], stresses[s, 1], stresses[s, 2]
        p10, p11, p12 = stresses[s, 3], stresses[s, 4], stresses[s, 5]
        p20, p21, p22 = stresses[s, 6], stresses[s, 7], stresses[s, 8]
        total = 0.0
        for a in range(elements.nodes.shape[1]):
            v = elements.nodes[s, a]
            g0, g1, g2 = elements.gradients[s, a, 0], elements.gradients[s, a, 1], elements.gradients[s, a, 2]
            total += y[v, 0] * (p00 * g0 + p01 * g1 + p02 * g2)
            total += y[v, 1] * (p10 * g0 + p11 * g1 + p12 * g2)
            total += y[v, 2] * (p20 * g0 + p21 * g1 + p22 * g2)
        powers[s] += elements.weights[s] * total


@njit(cache=True, nogil=True)
def add_point_energies(elements: Elements, u: Array, factor: float, energies: Array) -> None:
    """Adds factor · w_s Ψ(F_s), J, to `energies` (s,); u is (n, 3) in metres."""
    for s in range(elements.weights.shape[0]):
        F = deformation_gradient(elements.nodes, elements.gradients, s, u)
        density = energy(elements.kind[s], F, elements.mu[s], elements.lam[s])
        energies[s] += factor * elements.weights[s] * density


@njit(cache=True, nogil=True)
def stresses_of_strains(elements: Elements, strains: Array, weights: Array, stresses: Array) -> int:
    """Writes w_s P_s, N m, at F = I + strain into `stresses` (T, c, 9), zero where the energy is infinite.

    Returns the number of those.
    """
    infinite = 0
    for t in range(strains.shape[0]):
        for s in range(strains.shape[1]):
            density, P = energy_stress(elements.kind[s], _deformed(strains[t, s]), elements.mu[s], elements.lam[s])
            infinite += density == np.inf
            for i in range(9):
                stresses[t, s, i] = weights[s] * P[i] if density < np.inf else 0.0
    return infinite


@njit(cache=True, nogil=True)
def point_stress_changes(elements: Elements, strains: Array, along: Array, weights: Array, changes: Array) -> None:
    """Writes w_s ∂²Ψ/∂F² : X_s at F = I + strain for the directions X = `along` into `changes`, all (T, c, 9).

    Zero where the energy is infinite.
    """
    X, T = np.empty((3, 3)), np.empty((3, 3))
    for t in range(strains.shape[0]):
        for s in range(strains.shape[1]):
            F = _deformed(strains[t, s])
            if energy(elements.kind[s], F, elements.mu[s], elements.lam[s]) == np.inf:
                changes[t, s] = 0.0
                continue
            U, V, D, O = tangent(elements.kind[s], F, elements.mu[s], elements.lam[s], False)
            for i in range(3):
                for j in range(3):
                    X[i, j] = 0.0
                    for a in range(3):
                        for b in range(3):
                            X[i, j] += U[3 * a + i] * along[t, s, 3 * a + b] * V[3 * b + j]
            T[0, 0] = D[0] * X[0, 0] + D[3] * X[1, 1] + D[4] * X[2, 2]
            T[1, 1] = D[3] * X[0, 0] + D[1] * X[1, 1] + D[5] * X[2, 2]
            T[2, 2] = D[4] * X[0, 0] + D[5] * X[1, 1] + D[2] * X[2, 2]
            T[0, 1], T[1, 0] = O[0] * X[0, 1] + O[3] * X[1, 0], O[0] * X[1, 0] + O[3] * X[0, 1]
            T[0, 2], T[2, 0] = O[1] * X[0, 2] + O[4] * X[2, 0], O[1] * X[2, 0] + O[4] * X[0, 2]
            T[1, 2], T[2, 1] = O[2] * X[1, 2] + O[5] * X[2, 1], O[2] * X[2, 1] + O[5] * X[1, 2]
            for i in range(3):
                for j in range(3):
                    total = 0.0
                    for a in range(3):
                        for b in range(3):
                            total += U[3 * i + a] * T[a, b] * V[3 * j + b]
                    changes[t, s, 3 * i + j] = weights[s] * total


@njit(cache=True, inline="always")
def _deformed(strain: Array) -> Matrix:
    """F = I + strain, (9,)."""
    return (
        1.0 + strain[0],
        strain[1],
        strain[2],
        strain[3],
        1.0 + strain[4],
        strain[5],
        strain[6],
        strain[7],
        1.0 + strain[8],
    )
