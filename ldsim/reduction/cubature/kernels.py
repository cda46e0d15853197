"""The compiled loops of cubature that the mechanics does not have."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ldsim.mechanics.elastic import Elements, deformation_gradient
from ldsim.mechanics.materials import energy

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
