"""The latent dimension: trained as given, or the smallest that meets a tolerance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.learn import Trained

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
    the leading codes remain, which do. Where even all ordered codes miss the tolerance, one training of as many tells
    how many times better its own trainings are, and the size at which the ordered codes are that many times off is
    trained next.

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

    def attempt(size: int, own: bool) -> tuple[Trained, float]:
        trained = train(size) if own else ordered(size)
        tried.append((size, *error(trained), own))
        return trained, tried[-1][1]

    if r is not None:
        trained, largest = attempt(r, own=True)
        return Searched(trained, *_table(tried), largest <= tolerance)
    most = min(k, ORDERED_CODES)
    best, least = attempt(most, own=False)
    left, better = TRAININGS, 1.0
    if least > tolerance:
        best, largest = attempt(most, own=True)
        if largest > tolerance:
            return Searched(_beyond(k, most, attempt, tried, tolerance), *_table(tried), True)
        left, better = left - 1, least / largest
    low, high = 0, most
    while high - low > 1:
        middle = (low + high) // 2
        smaller, largest = attempt(middle, own=False)
        low, high = (low, middle) if largest <= better * tolerance else (middle, high)
        best = smaller if largest <= tolerance else best
    size = high - 1 if high > 1 and better == 1.0 else high
    while left and 1 <= size <= high and not any(entry[0] == size and entry[3] for entry in tried):
        trained, largest = attempt(size, own=True)
        best = trained if largest <= tolerance else best
        size = size - 1 if largest <= tolerance else size + 1
        left -= 1
    return Searched(best, *_table(tried), True)


def _beyond(
    k: int,
    size: int,
    attempt: Callable[[int, bool], tuple[Trained, float]],
    tried: list[tuple[int, float, float, bool]],
    tolerance: float,
) -> Trained:
    """Where as many codes as are ordered do not suffice: sizes of their own, each half as large again."""
    while size < k:
        size = min(k, size + size // 2 + 1)
        trained, largest = attempt(size, True)
        if largest <= tolerance:
            return trained
    raise SolverError(
        f"no latent dimension up to k = {k} brings the vertex error below {1e3 * tolerance:g} mm (the least is "
        f"{1e3 * min(entry[1] for entry in tried):.3g} mm); raise train.tolerance_mm or pca.k"
    )


def _table(tried: list[tuple[int, float, float, bool]]) -> tuple[Array, NDArray[np.bool_]]:
    table = np.array([[size, 1e3 * largest, 1e3 * mean] for size, largest, mean, _ in tried])
    return table, np.array([own for *_, own in tried], dtype=bool)
