"""Cubature points and weights for the reduced elastic force: greedy, non-negative, then thinned and exchanged.

Greedy choice of the points best correlated with the residual, with non-negative least squares after every addition: An,
Kim and James 2008, "Optimizing Cubature for Efficient Integration of Subspace Deformations", Sec. 5; adding several a
pass and dropping those of weight zero follows von Tycowicz, Schulz, Seidel and Hildebrandt 2013, "An Efficient
Construction of Reduced Deformable Objects", Sec. 4. Deviations: every pass looks at all points instead of a random few,
and picks one by one from the best; at the tolerance, points are taken out again and exchanged as long as that leaves
fewer or a lower error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.reduction.cubature.candidates import Candidates, System
from ldsim.reduction.cubature.forces import ProjectedForces

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Progress = Callable[[int, float], None]

SMALLEST_STEP = 4
GROWTH = 0.04
# Shares of the points exchanged at once, the next one tried when one no longer helps, and how often in all.
EXCHANGE_SHARES = (0.1, 0.2, 0.4)
EXCHANGES = 40
# Points whose columns a pass computes, for each that it will add: more and the passes are fewer, not the points.
COMPANY = 10
LEAST_GAIN = 1e-3
POINTS_AT_ONCE = 512


@dataclass(frozen=True, eq=False)
class CubatureSet:
    """A smaller quadrature rule.

    Attributes:
        points: quadrature points of the scene, ascending, (c,) int64.
        weights: their weights, (c,) float64, m³, positive; they replace the scene's.
        training_error: ‖Σ w b − target‖ / ‖target‖ over the normalised poses of the fit.

    Raises:
        SolverError: on shapes that differ, a point given twice, or a weight that is not positive and finite.
    """

    points: Indices
    weights: Array
    training_error: float

    def __post_init__(self) -> None:
        if self.points.ndim != 1 or self.points.shape != self.weights.shape:
            raise SolverError(
                f"cubature set has points of shape {self.points.shape} and weights of shape {self.weights.shape}; "
                "both must be (c,)"
            )
        if len(np.unique(self.points)) < len(self.points):
            raise SolverError("cubature set has a point twice; give each one weight")
        if not (np.isfinite(self.weights).all() and (self.weights > 0).all()):
            raise SolverError(f"cubature weight is {self.weights.min():g} m³; all must be positive and finite")


@dataclass(frozen=True)
class CubatureFit:
    """What a fit found.

    Attributes:
        ladder: sets of growing size and falling error, the last of which is `best`.
        best: the smallest set found that meets the tolerance, or else the one of least error.
        met: whether `best` meets the tolerance.
    """

    ladder: tuple[CubatureSet, ...]
    best: CubatureSet
    met: bool


def fit(
    forces: ProjectedForces,
    tolerance: float,
    max_points: int,
    volume_weight: float = 0.3,
    progress: Progress | None = None,
) -> CubatureFit:
    """The smallest cubature set found whose relative error is at most `tolerance`.

    Args:
        forces: the projected forces of the training poses.
        tolerance: relative error to reach.
        max_points: most points of any set returned.
        volume_weight: weight of the row that asks for the total volume, relative to the forces; 0 leaves it out.
        progress: told the number of points and the relative error after each change.

    Raises:
        SolverError: on a tolerance that is not positive, a limit below 1 or a negative volume weight.
    """
    _check(tolerance, max_points, volume_weight)
    ladder = _Ladder(progress)
    start = Candidates.none(System(forces, volume_weight))
    grown = _grow(start, tolerance, max_points, ladder)
    refined = _exchange(_thin(grown, tolerance, ladder), tolerance, ladder)
    _shrink(refined, 1, ladder)
    return ladder.result(tolerance)


def relative_error(forces: ProjectedForces, cubature: CubatureSet) -> float:
    """‖Σ w b − target‖ / ‖target‖ over the normalised poses of `forces`, whether trained on or not."""
    if len(cubature.points) and not (cubature.points.min() >= 0 and cubature.points.max() < forces.n_points):
        raise SolverError(
            f"cubature set has points {cubature.points.min()} … {cubature.points.max()}, the scene has "
            f"{forces.n_points}; use the scene it was fitted on"
        )
    multipliers = cubature.weights / forces.point_weights[cubature.points]
    residual = forces.target.copy()
    for first in range(0, len(multipliers), POINTS_AT_ONCE):
        chunk = slice(first, first + POINTS_AT_ONCE)
        residual -= forces.columns(cubature.points[chunk]) @ multipliers[chunk]
    return float(np.linalg.norm(residual) / np.linalg.norm(forces.target))


class _Ladder:
    """The best set seen of each size."""

    def __init__(self, progress: Progress | None) -> None:
        self._sets: dict[int, CubatureSet] = {}
        self._progress = progress

    def record(self, state: Candidates) -> None:
        error = state.error
        known = self._sets.get(state.size)
        if state.size and (known is None or error < known.training_error):
            order = np.argsort(state.chosen)
            points = state.chosen[order]
            weights = state.multipliers[order] * state.system.forces.point_weights[points]
            self._sets[state.size] = CubatureSet(points, weights, error)
        if self._progress is not None:
            self._progress(state.size, error)

    def result(self, tolerance: float) -> CubatureFit:
        """Sizes upwards, leaving out what is no better than a smaller set, to the first that meets the tolerance."""
        rungs: list[CubatureSet] = []
        for _, candidate in sorted(self._sets.items()):
            if rungs and candidate.training_error >= rungs[-1].training_error:
                continue
            rungs.append(candidate)
            if candidate.training_error <= tolerance:
                break
        return CubatureFit(tuple(rungs), rungs[-1], rungs[-1].training_error <= tolerance)


def _grow(state: Candidates, tolerance: float, max_points: int, ladder: _Ladder) -> Candidates:
    """Adds points, a few a pass, until the tolerance, the limit, or no more gain."""
    while state.error > tolerance and state.size < max_points:
        step = min(max(SMALLEST_STEP, math.ceil(GROWTH * state.size)), max_points - state.size)
        grown = _add(state, step, tolerance, ladder)
        if not np.linalg.norm(grown.residual) < np.linalg.norm(state.residual):
            break
        state = grown
    return state


def _add(state: Candidates, step: int, tolerance: float, ladder: _Ladder | None) -> Candidates:
    """One pass over all points, then up to `step` additions from the best correlated."""
    state = state.refreshed(COMPANY * step)
    for _ in range(step):
        added = state.with_best()
        if added is None:
            break
        state = added
        if ladder is not None:
            ladder.record(state)
        if state.error <= tolerance:
            break
    return state


def _thin(state: Candidates, tolerance: float, ladder: _Ladder) -> Candidates:
    """Takes points out, the least missed first, while the tolerance holds."""
    while state.size > 1 and state.error <= tolerance:
        thinner = state.without_least()
        ladder.record(thinner)
        if thinner.error > tolerance:
            break
        state = thinner
    return state


def _shrink(state: Candidates, size: int, ladder: _Ladder | None) -> Candidates:
    """Takes points out, the least missed first, down to `size`."""
    while state.size > size:
        state = state.without_least()
        if ladder is not None:
            ladder.record(state)
    return state


def _exchange(state: Candidates, tolerance: float, ladder: _Ladder) -> Candidates:
    """Adds some points and takes as many out, while that lowers the error, thinning wherever the tolerance allows."""
    shares = list(EXCHANGE_SHARES)
    for _ in range(EXCHANGES):
        step = max(SMALLEST_STEP, math.ceil(shares[0] * state.size))
        other = _shrink(_add(state, step, 0.0, None), state.size, None)
        if other.error < state.error * (1 - LEAST_GAIN):
            ladder.record(other)
            state = _thin(other, tolerance, ladder)
            continue
        shares.pop(0)
        if not shares:
            break
    return state


def _check(tolerance: float, max_points: int, volume_weight: float) -> None:
    if not tolerance > 0:
        raise SolverError(f"cubature tolerance is {tolerance:g}; it must be positive, as 0.05")
    if max_points < 1:
        raise SolverError(f"cubature max_points is {max_points}; it must be at least 1")
    if not 0 <= volume_weight < math.inf:
        raise SolverError(f"cubature volume_weight is {volume_weight:g}; it must be 0 (none) or positive and finite")
