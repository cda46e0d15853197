"""Sets of cubature points: a smaller quadrature rule, on the mesh or virtual, and the best one found of each size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.candidates import Candidates
from ldsim.cubature.rows import Rows
from ldsim.cubature.rule import CubatureRule
from ldsim.errors import SolverError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Progress = Callable[[int, float], None]

POINTS_AT_ONCE = 512


@dataclass(frozen=True, eq=False)
class VirtualSelection:
    """Virtual points with their errors on poses kept back from everything, and on perturbed states of these.

    Attributes:
        closure: share of the true poses' forces that they aim at.
        tried: share and judged error of what was tried, (t, 2); the first row, with no share, is the best set on the
            mesh.
    """

    cubature: CubatureRule
    heldout_error: float
    perturbed_error: float
    closure: float
    tried: Array

    @property
    def worse_than_mesh(self) -> bool:
        """Whether the best set on the mesh was judged better by more than a tenth."""
        return bool(np.nanmin(self.tried[1:, 1], initial=np.inf) > 1.1 * self.tried[0, 1])


@dataclass(frozen=True)
class CubatureFit:
    """What a fit found.

    Attributes:
        ladder: sets of growing size and falling error, the last of which is `best`.
        best: the smallest set found that meets the tolerance, or else the one of least error.
        met: whether `best` meets the tolerance.
    """

    ladder: tuple[CubatureRule, ...]
    best: CubatureRule
    met: bool


class Ladder:
    """The best set seen of each size.

    Args:
        progress: told the number of points and the relative error after each change.
    """

    def __init__(self, progress: Progress | None = None) -> None:
        self._sets: dict[int, CubatureRule] = {}
        self._progress = progress

    def record(self, state: Candidates) -> None:
        error = state.error
        known = self._sets.get(state.size)
        if state.size and (known is None or error < known.training_error):
            order = np.argsort(state.chosen)
            points = state.chosen[order]
            weights = state.multipliers[order] * state.system.forces.point_weights[points]
            self._sets[state.size] = CubatureRule(points, weights, error)
        if self._progress is not None:
            self._progress(state.size, error)

    def result(self, tolerance: float) -> CubatureFit:
        """Sizes upwards, leaving out what is no better than a smaller set, to the first that meets the tolerance."""
        rungs: list[CubatureRule] = []
        for _, candidate in sorted(self._sets.items()):
            if rungs and candidate.training_error >= rungs[-1].training_error:
                continue
            rungs.append(candidate)
            if candidate.training_error <= tolerance:
                break
        return CubatureFit(tuple(rungs), rungs[-1], rungs[-1].training_error <= tolerance)


def relative_errors(forces: Rows, sets: Sequence[CubatureRule]) -> Array:
    """‖Σ w b − target‖ / ‖target‖ of each set over the normalised poses of `forces`, trained on or not, (l,).

    Raises:
        SolverError: a set has points that the scene does not have.
    """
    errors: Array = np.linalg.norm(residuals(forces, sets), axis=0) / np.linalg.norm(forces.target)
    return errors


def residuals(forces: Rows, sets: Sequence[CubatureRule]) -> Array:
    """target − Σ w b of each set, (rows, l) float64.

    Raises:
        SolverError: a set has points that the scene does not have.
    """
    points = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(entry.points for entry in sets)]))
    if len(points) and not (points[0] >= 0 and points[-1] < forces.n_points):
        raise SolverError(
            f"cubature set has points {points[0]} … {points[-1]}, the scene has {forces.n_points}; use the scene "
            "it was fitted on"
        )
    multipliers = np.zeros((len(points), len(sets)))
    for i, entry in enumerate(sets):
        multipliers[np.searchsorted(points, entry.points), i] = entry.weights / forces.point_weights[entry.points]
    left = np.repeat(forces.target[:, None], len(sets), axis=1)
    for first in range(0, len(points), POINTS_AT_ONCE):
        chunk = slice(first, first + POINTS_AT_ONCE)
        left -= forces.columns(points[chunk]) @ multipliers[chunk]
    return left


def relative_error(forces: Rows, cubature: CubatureRule) -> float:
    """`relative_errors` of one set."""
    return float(relative_errors(forces, [cubature])[0])
