"""How an error of the reduced force is measured: by the displacement that it causes, not by its size.

A force error e displaces the solid by K⁻¹e and costs the energy ½ eᵀK⁻¹e. Its plain size hides the soft directions, in
which the solid moves most and in which the stiffest ones, a hundred times stiffer, leave nothing of a tolerance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldsim.space.decoder import Decoder

Array = NDArray[np.float64]


def rest_compliance(stiffness: Array, decoder: Decoder, z: Array) -> Array:
    """W = K_z^(−1/2), symmetric, with K_z = mean_t J(z_t)ᵀ K̃₀ J(z_t); so ‖Wᵀf‖² = fᵀ K_z⁻¹ f.

    Args:
        stiffness: K̃₀ = UᵀK₀U, (k, k).
        decoder: φ: R^r → R^k.
        z: poses to average over, (T, r).

    Returns:
        (r, r) float64. Directions softer than 1e-12 of the stiffest count as that stiff.
    """
    average = np.zeros((decoder.r, decoder.r))
    for row in z:
        J = decoder.jacobian(row)
        average += J.T @ stiffness @ J / len(z)
    values, vectors = np.linalg.eigh(average)
    W: Array = (vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))) @ vectors.T
    return W
