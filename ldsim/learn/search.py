"""The latent dimension: trained as given, or the smallest that meets a tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ldsim.errors import SolverError
from ldsim.learn.training import Trained

# Codes of the ordered training; more are tried only where these miss the tolerance.
ORDERED_CODES = 24
# Trainings after the ordered one: its cost and theirs together stay within three trainings at the final r.
TRAININGS = 2


class Trainer(Protocol):
    """What the search tries sizes with."""

    def alone(self, r: int) -> Trained:
        """A training of one size."""

    def leading(self, r: int) -> Trained:
        """So many leading codes of an ordered training, which is made once, as large as the first that is asked for."""

    def error(self, trained: Trained) -> tuple[float, float]:
        """Largest and mean vertex error over the training snapshots, metres."""


@dataclass(frozen=True, eq=False)
class Attempt:
    """A size tried: its largest and mean training error in metres, and whether it was trained for itself."""

    trained: Trained
    r: int
    largest: float
    mean: float
    own: bool


@dataclass(frozen=True, eq=False)
class Searched:
    """The autoencoder that was kept, every size tried, in that order, and whether the tolerance was met."""

    trained: Trained
    tried: tuple[Attempt, ...]
    met: bool


def search(trainer: Trainer, k: int, r: int | None, tolerance: float) -> Searched:
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
        tolerance: metres.

    Raises:
        SolverError: no r up to k meets the tolerance.
    """
    sizes = _Search(trainer, k, tolerance)
    kept = sizes.smallest() if r is None else sizes.attempt(r, own=True)
    return Searched(kept.trained, tuple(sizes.tried), kept.largest <= tolerance)


class _Search:
    """The sizes tried so far, and the rules for the next."""

    def __init__(self, trainer: Trainer, k: int, tolerance: float) -> None:
        self.trainer, self.k, self.tolerance = trainer, k, tolerance
        self.tried: list[Attempt] = []

    def attempt(self, r: int, own: bool) -> Attempt:
        trained = self.trainer.alone(r) if own else self.trainer.leading(r)
        self.tried.append(Attempt(trained, r, *self.trainer.error(trained), own))
        return self.tried[-1]

    def smallest(self) -> Attempt:
        """The smallest size that meets the tolerance, by bisection and a few trainings."""
        most, left, better = min(self.k, ORDERED_CODES), TRAININGS, 1.0
        best = all_codes = self.attempt(most, own=False)
        if all_codes.largest > self.tolerance:
            best = self.attempt(most, own=True)
            if best.largest > self.tolerance:
                return self.beyond(most)
            left, better = left - 1, all_codes.largest / best.largest
        low, high = 0, most
        while high - low > 1:
            codes = self.attempt((low + high) // 2, own=False)
            low, high = (low, codes.r) if codes.largest <= better * self.tolerance else (codes.r, high)
            best = codes if codes.largest <= self.tolerance else best
        size = high - 1 if high > 1 and better == 1.0 else high
        while left and 1 <= size <= high and not any(each.r == size and each.own for each in self.tried):
            alone = self.attempt(size, own=True)
            met = alone.largest <= self.tolerance
            best, size, left = (alone, size - 1, left - 1) if met else (best, size + 1, left - 1)
        return best

    def beyond(self, size: int) -> Attempt:
        """Where as many codes as are ordered do not suffice: sizes of their own, each half as large again."""
        while size < self.k:
            size = min(self.k, size + size // 2 + 1)
            alone = self.attempt(size, own=True)
            if alone.largest <= self.tolerance:
                return alone
        least = min(each.largest for each in self.tried)
        raise SolverError(
            f"no latent dimension up to k = {self.k} brings the vertex error below {1e3 * self.tolerance:g} mm (the "
            f"least is {1e3 * least:.3g} mm); raise train.tolerance_mm or pca.k"
        )
