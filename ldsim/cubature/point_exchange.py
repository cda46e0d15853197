"""Cubature by exchange: greedy additions, then points taken out and exchanged while that leaves fewer or a lower error.

Greedy choice of the points best correlated with the residual, with non-negative least squares after every addition: An,
Kim and James 2008, "Optimizing Cubature for Efficient Integration of Subspace Deformations", Sec. 5; adding several a
pass and dropping those of weight zero follows von Tycowicz, Schulz, Seidel and Hildebrandt 2013, "An Efficient
Construction of Reduced Deformable Objects", Sec. 4. Deviations: every pass looks at all candidates instead of a random
few, and picks one by one from the best; at the tolerance, points are taken out again and exchanged as long as that
leaves fewer or a lower error.
"""

from __future__ import annotations

import math

import numpy as np

from ldsim.cubature.options import FitOptions
from ldsim.cubature.path import PathBuilder
from ldsim.cubature.system import Candidates

SMALLEST_STEP = 4
GROWTH = 0.04
# Shares of the points exchanged at once, the next one tried when one no longer helps, and how often in all.
EXCHANGE_SHARES = (0.1, 0.2, 0.4)
EXCHANGES = 40
# Points whose columns a pass computes, for each that it will add: more and the passes are fewer, not the points.
COMPANY = 10
LEAST_GAIN = 1e-3


def exchange(start: Candidates, options: FitOptions, path: PathBuilder) -> None:
    """Grows to the tolerance, thins, exchanges, and takes points out one by one for the path down to one."""
    grown = _grow(start, options.tolerance, options.max_points, path)
    refined = _exchange(_thin(grown, options.tolerance, path), options.tolerance, path)
    _shrink(refined, 1, path)


def _grow(state: Candidates, tolerance: float, max_points: int, path: PathBuilder) -> Candidates:
    """Adds points, a few a pass, until the tolerance, the limit, or no more gain."""
    while state.error > tolerance and state.size < max_points:
        step = min(max(SMALLEST_STEP, math.ceil(GROWTH * state.size)), max_points - state.size)
        grown = _add(state, step, tolerance, path)
        if not np.linalg.norm(grown.residual) < np.linalg.norm(state.residual):
            break
        state = grown
    return state


def _add(state: Candidates, step: int, tolerance: float, path: PathBuilder | None) -> Candidates:
    """One pass over all points, then up to `step` additions from the best correlated."""
    state = state.refreshed(COMPANY * step)
    for _ in range(step):
        added = state.with_best()
        if added is None:
            break
        state = added
        if path is not None:
            path.record(state)
        if state.error <= tolerance:
            break
    return state


def _thin(state: Candidates, tolerance: float, path: PathBuilder) -> Candidates:
    """Takes points out, the least missed first, while the tolerance holds."""
    while state.size > 1 and state.error <= tolerance:
        thinner = state.without_least()
        path.record(thinner)
        if thinner.error > tolerance:
            break
        state = thinner
    return state


def _shrink(state: Candidates, size: int, path: PathBuilder | None) -> Candidates:
    """Takes points out, the least missed first, down to `size`."""
    while state.size > size:
        state = state.without_least()
        if path is not None:
            path.record(state)
    return state


def _exchange(state: Candidates, tolerance: float, path: PathBuilder) -> Candidates:
    """Adds some points and takes as many out, while that lowers the error, thinning wherever the tolerance allows."""
    shares = list(EXCHANGE_SHARES)
    for _ in range(EXCHANGES):
        step = max(SMALLEST_STEP, math.ceil(shares[0] * state.size))
        other = _shrink(_add(state, step, 0.0, None), state.size, None)
        if other.error < state.error * (1 - LEAST_GAIN):
            path.record(other)
            state = _thin(other, tolerance, path)
            continue
        shares.pop(0)
        if not shares:
            break
    return state
