"""The latent dimension: trained as given, or the smallest that meets a tolerance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.reduction.autoencoder import Trained, TrainingOptions, train

Array = NDArray[np.float64]

Progress = Callable[[int, int, float, float], None]


@dataclass(frozen=True, eq=False)
class Searched:
    """The autoencoder that was kept, and every size tried.

    Attributes:
        tried: r, largest and mean training error in mm, (tried, 3) float64, in the order tried.
        met: whether the tolerance was met.
    """

    trained: Trained
    tried: Array
    met: bool


def search(
    q: Array,
    r: int | None,
    options: TrainingOptions,
    error: Callable[[Trained], tuple[float, float]],
    tolerance: float,
    progress: Progress | None = None,
) -> Searched:
    """Train at r, or bisect for the smallest r whose largest training error is within the tolerance.

    Doubling from 1 finds a size that meets it, bisection then narrows the gap: 2 log₂ r trainings (the paper scans one
    by one from k/2, Sec. 4.3). Where error is not monotone in r, the result meets the tolerance but a smaller one might
    too.

    Args:
        q: coordinates of the training snapshots, (N, k) float64.
        error: largest and mean vertex error of a trained model over the training snapshots, metres.
        tolerance: metres.
        progress: called with r, epoch, training and validation loss.

    Raises:
        SolverError: no r up to k meets the tolerance.
    """
    tried: dict[int, tuple[Trained, float, float]] = {}

    def attempt(size: int) -> bool:
        if size not in tried:
            report = None if progress is None else (lambda e, a, b: progress(size, e, a, b))
            trained = train(q, size, options, report)
            tried[size] = (trained, *error(trained))
        return tried[size][1] <= tolerance

    if r is not None:
        met = attempt(r)
        return Searched(tried[r][0], _table(tried), met)
    k = q.shape[1]
    low, high = 0, 1
    while not attempt(high):
        if high == k:
            raise SolverError(
                f"no latent dimension up to k = {k} brings the vertex error below {1e3 * tolerance:g} mm (the least is "
                f"{1e3 * min(entry[1] for entry in tried.values()):.3g} mm); raise train.tolerance_mm or pca.k"
            )
        low, high = high, min(2 * high, k)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if attempt(middle) else (middle, high)
    return Searched(tried[high][0], _table(tried), True)


def _table(tried: dict[int, tuple[Trained, float, float]]) -> Array:
    return np.array([[size, 1e3 * largest, 1e3 * mean] for size, (_, largest, mean) in tried.items()])
