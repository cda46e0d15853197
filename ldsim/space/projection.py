"""How well a space can represent given displacements, in metres at the vertices."""

from __future__ import annotations

import numpy as np

from ldsim.arrays import Array
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.pca import Chunks


def all_coordinates(chunks: Chunks, basis: Basis) -> Array:
    """q of every snapshot, (N, k) float64."""
    found = [basis.project(chunk) for chunk in chunks()]
    return np.concatenate(found) if found else np.empty((0, basis.k))


def reconstruction_error(chunks: Chunks, basis: Basis, encoder: Encoder, decoder: Decoder) -> tuple[float, float]:
    """Largest and mean distance, metres, between the vertices of u and of U φ(ψ(UᵀMu)); NaN without snapshots."""
    largest, total, count = 0.0, 0.0, 0
    for chunk in chunks():
        decoded = decoder(encoder(basis.project(chunk))) @ basis.matrix.T
        distance = np.linalg.norm((decoded - chunk).reshape(len(chunk), -1, 3), axis=2)
        largest = max(largest, float(distance.max()))
        total += float(distance.sum())
        count += distance.size
    return (largest, total / count) if count else (float("nan"), float("nan"))


def matching_dimension(max_error: Array, target: float) -> int:
    """The PCA dimension, at least 1, whose largest vertex error is nearest to `target` (kp of the paper, Sec. 6).

    Args:
        max_error: largest vertex error with 0, 1, … modes, (k + 1,), metres.
    """
    return int(np.abs(max_error[1:] - target).argmin()) + 1
