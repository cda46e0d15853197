"""How far a latent state is from what the model was trained on: a score for every step, and from where on to warn.

The score is the distance to the nearest of some training codes, the landmarks, in units of the spread of the training
codes (a nearest-neighbour novelty score; Ramaswamy et al. 2000). Rest is a landmark too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ldsim.reduction.decoder import Decoder
from ldsim.reduction.encoder import Encoder, nearest_latent

Array = NDArray[np.float64]

LANDMARKS = 256
# Held-out poses looked at, and what counts as badly decoded: worse than this share of the training poses, twice over.
POSES = 200
USUAL = 0.95
FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class Trust:
    """What the score is computed from.

    Attributes:
        landmarks: whitened training codes, (L, r) float64.
        whitening: W with W z whitened, (r, r) float64; scaled so that 99 % of the training codes score at most 1.
        threshold: the score from which on to warn.
    """

    landmarks: Array
    whitening: Array
    threshold: float

    def __call__(self, z: Array) -> Array:
        """Scores of codes (N, r); (N,) float64, NaN where a code is not finite."""
        scores: Array = np.array([score(self.landmarks, self.whitening, row) for row in np.ascontiguousarray(z)])
        return scores


@njit(cache=True, nogil=True)
def score(landmarks: Array, whitening: Array, z: Array) -> float:
    """Distance of W z to the nearest landmark; a few thousand multiplications, no allocation but one of r numbers."""
    r = z.shape[0]
    x = np.zeros(r)
    for i in range(r):
        for j in range(r):
            x[i] += whitening[i, j] * z[j]
    least = math.inf
    for l in range(landmarks.shape[0]):
        total = 0.0
        for i in range(r):
            difference = landmarks[l, i] - x[i]
            total += difference * difference
        least = min(least, total)
    return math.sqrt(least) if math.isfinite(x.sum()) else math.nan


def fit_trust(decoder: Decoder, encoder: Encoder, q: Array, unseen: Array) -> Trust:
    """Landmarks from the training motions, the threshold from the held-out ones.

    A held-out pose is badly decoded when the error of its nearest code, relative to the spread of the training
    coordinates, is twice what 95 % of the training poses stay below. The threshold is the score that tells such poses
    from the others best (the largest difference of the two shares, Youden 1950). Without held-out poses, or where all
    are of one kind, it is 2: twice as far as 99 % of the training poses.

    Args:
        q, unseen: coordinates of the training and the held-out snapshots, (N, k); unseen may be empty.
    """
    z = encoder(q)
    centred = z - z.mean(axis=0)
    values, vectors = np.linalg.eigh(centred.T @ centred / len(z))
    whitening = (vectors / np.sqrt(np.maximum(values, 1e-6 * values[-1]))).T
    # At most every second code is a landmark, so that the others tell how far apart neighbours are.
    landmarks = _spread(np.vstack([np.zeros((1, z.shape[1])), z @ whitening.T]), min(LANDMARKS, len(z) // 2 + 1))
    scale = max(float(np.quantile(Trust(landmarks, whitening, 0.0)(z), 0.99)), 1e-6)
    trust = Trust(landmarks / scale, whitening / scale, 2.0)
    if len(unseen) == 0:
        return trust
    usual = float(np.quantile(np.linalg.norm(decoder(z) - q, axis=1), USUAL))
    poses = unseen[:: max(len(unseen) // POSES, 1)]
    guesses = encoder(poses)
    codes = np.array([nearest_latent(decoder, a, b) for a, b in zip(poses, guesses, strict=True)])
    bad = np.linalg.norm(decoder(codes) - poses, axis=1) > FACTOR * usual
    return Trust(trust.landmarks, trust.whitening, _separating(trust(codes), bad, trust.threshold))


def _spread(points: Array, most: int) -> Array:
    """At most so many of the points, each the farthest from those before; the first comes first."""
    chosen = [0]
    distance = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < most and distance.max() > 0:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.ascontiguousarray(points[chosen])


def _separating(scores: Array, bad: NDArray[np.bool_], otherwise: float) -> float:
    """The score that separates bad poses from good ones best; `otherwise` where there is only one kind."""
    if bad.all() or not bad.any():
        return otherwise
    candidates = np.unique(scores)
    hits = np.array([(scores[bad] >= c).mean() - (scores[~bad] >= c).mean() for c in candidates])
    return float(candidates[hits.argmax()])
