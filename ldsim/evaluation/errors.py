"""How far two runs are apart: vertex distances, their maximum and mean, and the online error of a reduced run.

Poses come in chunks of frames, so that no run has to fit in memory: an accumulator holds a few sums and a maximum.
Everything goes in in metres and comes out in millimetres, the unit of reports.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

MM_PER_M = 1000.0


@dataclass(frozen=True)
class ErrorSummary:
    """Largest and mean vertex distance over a set of poses, millimetres."""

    max_mm: float
    mean_mm: float


@dataclass(frozen=True)
class OnlineError:
    """How far a reduced run is from the full-space run of the same motion.

    Attributes:
        relative: mean vertex distance over mean displacement of the full-space run, both over all frames and
            vertices; None where the full-space run never moved, so that there is nothing to be relative to.
        max_mm: largest vertex distance of any frame, millimetres.
        mean_mm: mean vertex distance, millimetres.
    """

    relative: float | None
    max_mm: float
    mean_mm: float


def vertex_distances(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.float64]:
    """Distance of each vertex between two runs, frame by frame.

    Args:
        a, b: positions or displacements, (N, n, 3), metres. Float32 is widened before the difference is taken.

    Returns:
        (N, n) float64, metres. A value that is not finite (a run that blew up) counts as infinitely far.

    Raises:
        ValueError: if the shapes differ or are not (N, n, 3).
    """
    if a.shape != b.shape or a.ndim != 3 or a.shape[2] != 3:
        raise ValueError(f"poses have shapes {a.shape} and {b.shape}; expected twice the same (N, n, 3)")
    distances: NDArray[np.float64] = np.linalg.norm(
        np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64), axis=2
    )
    distances[~np.isfinite(distances)] = np.inf
    return distances


@final
class ErrorAccumulator:
    """Maximum and mean of vertex distances, fed in chunks."""

    def __init__(self) -> None:
        self._max = 0.0
        self._sum = 0.0
        self._count = 0

    def add(self, distances: NDArray[np.float64]) -> None:
        """Take in the distances (N, n) of one chunk of frames, metres."""
        if distances.size == 0:
            return
        self._max = max(self._max, float(distances.max()))
        self._sum += float(distances.sum())
        self._count += distances.size

    def summary(self) -> ErrorSummary:
        """Maximum and mean over every chunk so far.

        Raises:
            ValueError: if nothing was added; an error of nothing is not zero.
        """
        if self._count == 0:
            raise ValueError("no poses were added; an error needs at least one")
        return ErrorSummary(self._max * MM_PER_M, self._sum / self._count * MM_PER_M)


@final
class OnlineErrorAccumulator:
    """Online error of a reduced run against the full-space run of the same motion, fed in chunks."""

    def __init__(self) -> None:
        self._distances = ErrorAccumulator()
        self._displacements = ErrorAccumulator()

    def add(self, reduced: NDArray[np.floating], full: NDArray[np.floating]) -> NDArray[np.float64]:
        """Take in the displacements (N, n, 3) of the same frames of both runs, metres.

        Returns:
            The mean vertex distance of each of these frames, (N,) float64, millimetres: the curve to draw.
        """
        distances = vertex_distances(reduced, full)
        self._distances.add(distances)
        self._displacements.add(vertex_distances(full, np.zeros_like(full)))
        mean_mm: NDArray[np.float64] = distances.mean(axis=1) * MM_PER_M
        return mean_mm

    def result(self) -> OnlineError:
        """The error over every chunk so far.

        Raises:
            ValueError: if nothing was added.
        """
        error = self._distances.summary()
        moved = self._displacements.summary().mean_mm
        return OnlineError(error.mean_mm / moved if moved > 0 else None, error.max_mm, error.mean_mm)


def error_summary(a: NDArray[np.floating], b: NDArray[np.floating]) -> ErrorSummary:
    """Maximum and mean vertex distance of two runs (N, n, 3) that fit in memory, given in metres."""
    accumulator = ErrorAccumulator()
    accumulator.add(vertex_distances(a, b))
    return accumulator.summary()


def online_error(reduced: NDArray[np.floating], full: NDArray[np.floating]) -> OnlineError:
    """Online error of displacements (N, n, 3) that fit in memory, given in metres."""
    accumulator = OnlineErrorAccumulator()
    accumulator.add(reduced, full)
    return accumulator.result()
