"""The record of a motion in one space, whichever space it was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.optimise.solution import Reason

# Up to this online error a run is good.
LARGE_ONLINE_ERROR = 0.1


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A run of one motion in one space.

    Attributes:
        coordinates: q after each frame, (N, k); None for the full space.
        latent: z after each frame, (N, r); None for the full and the linear space.
        iterations, evaluations, reason: of each step, (N,).
        seconds: of each step, (N,) float64.
        mean_error, max_error: vertex distances to the full-space run in each frame, (N,) metres; None if not known.
        windowed_mean_error: the same, restarted from the full-space state every window.
        mean_displacement: of the full-space run in each frame, (N,) metres.
        novelty: distance to the training codes in each frame (`space.novelty`), (N,); latent space only.
    """

    iterations: Indices
    evaluations: Indices
    reason: Indices
    seconds: Array
    coordinates: Array | None = None
    latent: Array | None = None
    mean_error: Array | None = None
    max_error: Array | None = None
    windowed_mean_error: Array | None = None
    mean_displacement: Array | None = None
    novelty: Array | None = None

    @property
    def relative_error(self) -> float | None:
        """The online error: mean vertex distance to the full-space run over its mean displacement, if known."""
        return _ratio(self.mean_error, self.mean_displacement)

    @property
    def windowed_error(self) -> float | None:
        """The same, restarted from the full-space state every window."""
        return _ratio(self.windowed_mean_error, self.mean_displacement)

    @property
    def diverged(self) -> bool:
        """Whether the run ended in an infinite energy or left the solid ten diagonals behind (NaN from there on)."""
        lost = self.coordinates is not None and not np.isfinite(self.coordinates).all()
        return lost or bool((self.reason == Reason.INFINITE_START).any())


def _ratio(error: Array | None, moved: Array | None) -> float | None:
    """Σ error / Σ moved over the frames, infinite where the run was lost; None where nothing is known or moved."""
    if error is None or moved is None or not moved.sum() > 0:
        return None
    return float(error.sum() / moved.sum())
