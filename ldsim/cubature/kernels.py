"""The compiled loops of cubature that the mechanics does not have."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.jit import njit
from ldsim.mechanics.elastic import Elements
from ldsim.mechanics.materials.kernels import deformation, energy, weighted_stresses

# Length of a step in F to either side, for differences of the stress: about the cube root of the rounding, where its
# error and that of the difference are alike.
DIFFERENCE = 1e-5


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
def stresses_of_strains(elements: Elements, strains: Array, weights: Array, stresses: Array) -> int:
    """Writes w_s P_s, N m, at F = I + strain into `stresses` (T, c, 9), zero where the energy is infinite.

    Returns the number of those.
    """
    infinite, together = 0, np.empty((9, strains.shape[1]))
    for t in range(strains.shape[0]):
        # component by component, as the materials read them; what they return takes the place of the strain
        together[:] = strains[t].T
        whole = weighted_stresses(elements.kind, together, weights, elements.mu, elements.lam) < np.inf
        for s in range(strains.shape[1]):
            # the sum says only whether any point is infinite; which one is asked in that rare case alone
            finite = whole or _finite(elements, s, strains[t, s])
            infinite += not finite
            for i in range(9):
                stresses[t, s, i] = together[i, s] if finite else 0.0
    return infinite


@njit(cache=True, nogil=True)
def point_stress_changes(elements: Elements, strains: Array, along: Array, weights: Array, changes: Array) -> None:
    """Writes w_s ∂²Ψ/∂F² : X_s at F = I + strain for the directions X = `along` into `changes`, all (T, c, 9).

    Central differences of the stress, which need no singular values as a tangent does. Zero where an energy is
    infinite.
    """
    count = strains.shape[1]
    ahead, behind, steps = np.empty((9, count)), np.empty((9, count)), np.empty(count)
    kind, mu, lam = elements.kind, elements.mu, elements.lam
    for t in range(strains.shape[0]):
        for s in range(count):
            length = 0.0
            for i in range(9):
                length += along[t, s, i] * along[t, s, i]
            steps[s] = DIFFERENCE / math.sqrt(length) if length > 0.0 else 0.0
            for i in range(9):
                ahead[i, s] = strains[t, s, i] + steps[s] * along[t, s, i]
                behind[i, s] = strains[t, s, i] - steps[s] * along[t, s, i]
        up = weighted_stresses(kind, ahead, weights, mu, lam)
        down = weighted_stresses(kind, behind, weights, mu, lam)
        for s in range(count):
            finite = steps[s] > 0.0
            if finite and not (up < np.inf and down < np.inf):
                step = steps[s] * along[t, s]
                finite = _finite(elements, s, strains[t, s] + step) and _finite(elements, s, strains[t, s] - step)
            for i in range(9):
                changes[t, s, i] = 0.5 / steps[s] * (ahead[i, s] - behind[i, s]) if finite else 0.0


@njit(cache=True, inline="always")
def _finite(elements: Elements, s: int, strain: Array) -> bool:
    """Whether the energy of point s is finite at F = I + strain, (9,)."""
    return energy(elements.kind[s], deformation(strain.reshape(9, 1), 0), elements.mu[s], elements.lam[s]) < np.inf
