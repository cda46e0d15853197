"""How far a latent state is from what the model was trained on: a score for every step, and from where on to warn.

The score is the distance to the nearest of some training codes, the landmarks, as a multiple of what is usual among
them (a nearest-neighbour novelty score; Ramaswamy et al. 2000). Rest is a landmark too. Lengths in z mean what
they mean in q, because the latent space is scaled so after training; whitened codes would magnify directions in which
the training motions hardly moved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ldsim.arrays import Array
from ldsim.jit import njit
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder, nearest_latent

LANDMARKS = 256
# How long a run remembers that it was far from the training codes, seconds.
MEMORY = 0.5
# Validation poses looked at, and what counts as badly decoded: worse than this share of the training poses, twice over.
POSES = 200
USUAL = 0.95
FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class Novelty:
    """What the score is computed from.

    Attributes:
        landmarks: training codes, (L, r) float64.
        reach: the distance to the nearest landmark that 99 % of the training codes stay within.
        threshold: the score from which on to warn.

    Raises:
        ValueError: no landmark, or a number that is not finite or not positive.
    """

    landmarks: Array
    reach: float
    threshold: float

    def __post_init__(self) -> None:
        if self.landmarks.ndim != 2 or not len(self.landmarks) or not np.isfinite(self.landmarks).all():
            raise ValueError(f"landmarks of shape {self.landmarks.shape}; must be (L, r) finite codes, L > 0")
        if not 0 < self.reach < math.inf or not 0 <= self.threshold < math.inf:
            raise ValueError(f"reach is {self.reach:g}, threshold {self.threshold:g}; must be positive and finite")

    def __call__(self, z: Array) -> Array:
        """Scores of codes (N, r); (N,) float64, NaN where a code is not finite."""
        return np.array([distance(self.landmarks, row) for row in np.ascontiguousarray(z)]) / self.reach


def remembered(scores: Array, time_step: float) -> Array:
    """Scores of successive steps, each averaged over the past with weights that fall by e every MEMORY seconds.

    A run that has been among states it does not know goes on from a wrong one, and is off for a while after it is back:
    the memory follows the error of an uninterrupted run, the score itself tells where an error is being made.

    Args:
        scores: of each step, (N,), finite. time_step: seconds.
    """
    share = -math.expm1(-time_step / MEMORY)
    return lfilter([share], [1.0, share - 1.0], scores)


@njit(cache=True, nogil=True)
def distance(landmarks: Array, z: Array) -> float:
    """Distance of z to the nearest landmark, NaN where z is not finite; a few thousand multiplications."""
    least = math.inf
    for l in range(landmarks.shape[0]):
        total = 0.0
        for i in range(z.shape[0]):
            difference = landmarks[l, i] - z[i]
            total += difference * difference
        least = min(least, total)
    return math.sqrt(least) if math.isfinite(z.sum()) else math.nan


def fit_novelty(decoder: Decoder, encoder: Encoder, q: Array, unseen: Array) -> Novelty:
    """Landmarks from the training motions, the threshold from the validation ones.

    A validation pose is badly decoded when the error of its nearest code, relative to the spread of the training
    coordinates, is twice what 95 % of the training poses stay below. The threshold is the score that tells such poses
    from the others best (the largest difference of the two shares, Youden 1950), but never below 1, where the training
    poses are. Without validation poses, or where all are of one kind, it is 2: twice as far as 99 % of those.

    Args:
        q, unseen: coordinates of the training and the validation snapshots, (N, k); unseen may be empty.
    """
    z = encoder(q)
    # At most every second code is a landmark, so that the others tell how far apart neighbours are.
    landmarks = _spread(np.vstack([np.zeros((1, z.shape[1])), z]), min(LANDMARKS, len(z) // 2 + 1))
    usual = float(np.quantile(Novelty(landmarks, 1.0, 0.0)(z), 0.99))
    novelty = Novelty(landmarks, max(usual, 1e-6 * float(np.abs(z).max()), np.finfo(float).tiny), 2.0)
    if len(unseen) == 0:
        return novelty
    well = float(np.quantile(np.linalg.norm(decoder(z) - q, axis=1), USUAL))
    poses = unseen[:: max(len(unseen) // POSES, 1)]
    guesses = encoder(poses)
    codes = np.array([nearest_latent(decoder, a, b) for a, b in zip(poses, guesses, strict=True)])
    bad = np.linalg.norm(decoder(codes) - poses, axis=1) > FACTOR * well
    threshold = _separating(novelty(codes), bad, novelty.threshold)
    return Novelty(novelty.landmarks, novelty.reach, max(threshold, 1.0))


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
    ordered = np.unique(scores)
    if bad.all() or not bad.any() or len(ordered) < 2:
        return otherwise
    candidates = 0.5 * (ordered[1:] + ordered[:-1])
    hits = np.array([(scores[bad] >= c).mean() - (scores[~bad] >= c).mean() for c in candidates])
    return float(candidates[hits.argmax()])
