"""The latent dimension: trained as given, or the smallest that meets a tolerance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.reduction.autoencoder import Trained

Array = NDArray[np.float64]

# Codes of the ordered training; more are tried only where these miss the tolerance.
ORDERED_CODES = 24
# Trainings after the ordered one: its cost and theirs together stay within three trainings at the final r.
TRAININGS = 2

Train = Callable[[int], Trained]
TrainOrdered = Callable[[int], Trained]
Error = Callable[[Trained], tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Searched:
    """The autoencoder that was kept, and every size tried.

    Attributes:
        tried: r, largest and mean training error in mm, (tried, 3) float64, in the order tried.
        own: whether each was a training of that size, or the leading codes of an ordered one, (tried,).
        met: whether the tolerance was met.
    """

    trained: Trained
    tried: Array
    own: NDArray[np.bool_]
    met: bool


def search(k: int, r: int | None, train: Train, ordered: TrainOrdered, error: Error, tolerance: float) -> Searched:
    """Train at r, or find the smallest r whose largest training error is within the tolerance.

    Error is not monotone in r and scatters between seeds, so that a scan or a bisection over separate trainings
    (paper, Sec. 4.3) may stop anywhere. One training with ordered codes (Rippel et al. 2014) gives an autoencoder of
    every size at once, in which more codes are never meant to be worse. Bisection over its sizes, which costs no
    training, finds the smallest that meets the tolerance. A training of its own for a size does better than the
    leading codes of a larger one, so the next smaller sizes are then trained: at most two. Where none of them holds,
    the leading codes remain, which do.

    Args:
        k: outer dimension, the largest r.
        train: trains one size.
        ordered: trains ordered codes once, and gives the autoencoder of so many leading ones.
        error: largest and mean vertex error of a trained model over the training snapshots, metres.
        tolerance: metres.

    Raises:
        SolverError: no r up to k meets the tolerance.
    """
    tried: list[tuple[int, float, float, bool]] = []

    def attempt(size: int, own: bool) -> Trained | None:
        trained = train(size) if own else ordered(size)
        largest, mean = error(trained)
        tried.append((size, largest, mean, own))
        return trained if largest <= tolerance else None

    if r is not None:
        trained = train(r)
        largest, mean = error(trained)
        return Searched(trained, *_table([(r, largest, mean, True)]), largest <= tolerance)
    most = min(k, ORDERED_CODES)
    found = attempt(most, own=False)
    if found is None:
        beyond = _beyond(k, most, attempt, tried, tolerance)
        return Searched(beyond, *_table(tried), True)
    low, high = 0, most
    while high - low > 1:
        middle = (low + high) // 2
        smaller = attempt(middle, own=False)
        low, high, found = (low, middle, smaller) if smaller is not None else (middle, high, found)
    best: Trained = found
    size = high - 1 if high > 1 else high
    for _ in range(TRAININGS):
        trained_here = attempt(size, own=True)
        best = best if trained_here is None else trained_here
        following = size - 1 if trained_here is not None else size + 1
        if following < 1 or following > high or any(entry[0] == following and entry[3] for entry in tried):
            break
        size = following
    return Searched(best, *_table(tried), True)


def _beyond(
    k: int,
    size: int,
    attempt: Callable[[int, bool], Trained | None],
    tried: list[tuple[int, float, float, bool]],
    tolerance: float,
) -> Trained:
    """Where the ordered codes do not suffice: sizes of their own, each half as large again."""
    while True:
        trained = attempt(size, True)
        if trained is not None:
            return trained
        if size == k:
            raise SolverError(
                f"no latent dimension up to k = {k} brings the vertex error below {1e3 * tolerance:g} mm (the least is "
                f"{1e3 * min(entry[1] for entry in tried):.3g} mm); raise train.tolerance_mm or pca.k"
            )
        size = min(k, size + size // 2 + 1)


def _table(tried: list[tuple[int, float, float, bool]]) -> tuple[Array, NDArray[np.bool_]]:
    table = np.array([[size, 1e3 * largest, 1e3 * mean] for size, largest, mean, _ in tried])
    return table, np.array([own for *_, own in tried], dtype=bool)
