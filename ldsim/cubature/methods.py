"""Cubature as it was published: four ways to choose points, each on the same system and from its paper alone.

Each fills a ladder from one point upward and stops at the tolerance, at the most points allowed, or where no point
lowers the error.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.candidates import Candidates
from ldsim.cubature.goal import Goal
from ldsim.cubature.ladder import Ladder

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Candidates drawn for each addition of `an`: An et al. 2008, Sec. 5.3, take some hundreds; the paper's authors 200.
DRAWN = 200
# `nn_htp`: growth of the support between two solutions, and most iterations of one size.
SUPPORT_GROWTH = 0.15
THRESHOLDINGS = 6


def ecsw(start: Candidates, goal: Goal, ladder: Ladder) -> None:
    """Energy-conserving sampling and weighting: the non-negative least squares of Lawson and Hanson, stopped early.

    Farhat, Avery, Chapman and Cortial 2014, "Dimensional reduction of nonlinear finite element dynamic models with
    finite rotations and energy-based mesh sampling and weighting for computational efficiency", Algorithm 1: the
    steepest multiplier joins, those that would turn negative leave, until the tolerance is met. On the tangent of the
    decoder where the forces are so projected (Jain and Tiso 2017).
    """
    state = start
    while state.error > goal.tolerance and state.size < goal.max_points:
        added = state.refreshed(1).with_best()
        if added is None or not _closer(added, state):
            return
        state = added
        ladder.record(state)


def an(start: Candidates, goal: Goal, ladder: Ladder) -> None:
    """Greedy optimised cubature: of a random few, the point whose share points most along the residual joins.

    An, Kim and James 2008, Algorithm 1; all weights anew by non-negative least squares after each addition, and points
    of weight zero leave.
    """
    rng = np.random.default_rng(goal.seed)
    state, idle = start, 0
    while state.error > goal.tolerance and state.size < goal.max_points and idle < DRAWN:
        open_points = np.setdiff1d(start.system.allowed, state.chosen)
        if len(open_points) == 0:
            return
        drawn = rng.choice(open_points, min(DRAWN, len(open_points)), replace=False)
        added = state.among(drawn).with_best()
        if added is None or not _closer(added, state):
            idle += 1
            continue
        state, idle = added, 0
        ladder.record(state)


def nn_htp(start: Candidates, goal: Goal, ladder: Ladder) -> None:
    """Non-negative hard thresholding pursuit, for supports of growing size.

    Von Tycowicz, Schulz, Seidel and Hildebrandt 2013, Sec. 4: step along the gradient, keep the largest positive
    entries, solve non-negative least squares on them, until these stay the same. The step is the exact one along the
    gradient's part on the support (Foucart 2011, "Hard thresholding pursuit"). The size grows by a share a time; each
    size starts from the solution of the one before.
    """
    state, size, largest = start, 0, min(goal.max_points, len(start.system.allowed))
    while state.error > goal.tolerance and size < largest:
        size = min(max(size + 1, math.ceil((1 + SUPPORT_GROWTH) * size)), largest)
        seen: list[frozenset[int]] = []
        for _ in range(THRESHOLDINGS):
            support = _thresholded(state, size)
            if len(support) == 0 or frozenset(support.tolist()) in seen:
                break
            seen.append(frozenset(support.tolist()))
            state = state.solved_on(support)
            ladder.record(state)
            if state.error <= goal.tolerance:
                break


def uniform(start: Candidates, goal: Goal, ladder: Ladder) -> None:
    """The floor: points drawn at random in proportion to their volume, each with an equal share of the whole.

    Monte Carlo integration; nothing is fitted, so its error falls with the root of the number of points.
    """
    allowed, weights = start.system.allowed, start.system.forces.point_weights
    rng = np.random.default_rng(goal.seed)
    share = weights[allowed] / weights[allowed].sum()
    order = rng.choice(allowed, min(goal.max_points, len(allowed)), replace=False, p=share)
    size = 0
    while size < len(order):
        size = min(max(size + 1, math.ceil((1 + SUPPORT_GROWTH) * size)), len(order))
        points = order[:size]
        state = start.given(points, weights.sum() / size / weights[points])
        ladder.record(state)
        if state.error <= goal.tolerance:
            return


def _closer(new: Candidates, old: Candidates) -> bool:
    return bool(np.linalg.norm(new.residual) < np.linalg.norm(old.residual))


def _thresholded(state: Candidates, size: int) -> Indices:
    """The `size` largest positive entries of x + μ Aᵀ(b − A x), x the multipliers of all points."""
    system = state.system
    slopes = np.where(np.isfinite(slope := system.correlations(state.residual)), slope, 0.0)
    multipliers = np.zeros(system.n_points)
    multipliers[state.chosen] = state.multipliers
    support = state.chosen if state.size else np.argsort(-slopes, kind="stable")[:size]
    image = system.columns(support) @ slopes[support]
    squared = float(image @ image)
    step = float(slopes[support] @ slopes[support]) / squared if squared > 0 else 0.0
    moved = multipliers + step * slopes
    largest = np.argsort(-moved, kind="stable")[:size]
    return largest[moved[largest] > 0]
