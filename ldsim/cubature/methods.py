"""The methods that choose points: ours (`exchange`) and four as they were published, each from its paper alone.

All work on the same system and fill a path from one point upward. They stop at the tolerance, at the most points
allowed, or where no point lowers the error.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ldsim.arrays import Indices
from ldsim.cubature.options import FitOptions
from ldsim.cubature.path import PathBuilder, RulePath, Tell
from ldsim.cubature.point_exchange import exchange
from ldsim.cubature.system import Candidates, System

Method = Callable[[Candidates, FitOptions, PathBuilder], None]

# Candidates drawn for each addition of `an`: An et al. 2008, Sec. 5.3, take some hundreds; the paper's authors 200.
DRAWN = 200
# `nn_htp`: growth of the support between two solutions, and most iterations of one size.
SUPPORT_GROWTH = 0.15
THRESHOLDINGS = 6


def ecsw(start: Candidates, options: FitOptions, path: PathBuilder) -> None:
    """Energy-conserving sampling and weighting: the non-negative least squares of Lawson and Hanson, stopped early.

    Farhat, Avery, Chapman and Cortial 2014, "Dimensional reduction of nonlinear finite element dynamic models with
    finite rotations and energy-based mesh sampling and weighting for computational efficiency", Algorithm 1: the
    steepest multiplier joins, those that would turn negative leave, until the tolerance is met. On the tangent of the
    decoder where the forces are so projected (Jain and Tiso 2017).
    """
    state = start
    while state.error > options.tolerance and state.size < options.max_points:
        added = state.refreshed(1).with_best()
        if added is None or not _closer(added, state):
            return
        state = added
        path.record(state)


def an(start: Candidates, options: FitOptions, path: PathBuilder) -> None:
    """Greedy optimised cubature: of a random few, the point whose share points most along the residual joins.

    An, Kim and James 2008, Algorithm 1; all weights anew by non-negative least squares after each addition, and points
    of weight zero leave.
    """
    rng = np.random.default_rng(options.seed)
    state, idle = start, 0
    while state.error > options.tolerance and state.size < options.max_points and idle < DRAWN:
        open_points = np.setdiff1d(start.system.allowed, state.chosen)
        if len(open_points) == 0:
            return
        drawn = rng.choice(open_points, min(DRAWN, len(open_points)), replace=False)
        added = state.among(drawn).with_best()
        if added is None or not _closer(added, state):
            idle += 1
            continue
        state, idle = added, 0
        path.record(state)


def nn_htp(start: Candidates, options: FitOptions, path: PathBuilder) -> None:
    """Non-negative hard thresholding pursuit, for supports of growing size.

    Von Tycowicz, Schulz, Seidel and Hildebrandt 2013, Sec. 4: step along the gradient, keep the largest positive
    entries, solve non-negative least squares on them, until these stay the same. The step is the exact one along the
    gradient's part on the support (Foucart 2011, "Hard thresholding pursuit"). The size grows by a share a time; each
    size starts from the solution of the one before.
    """
    state, size, largest = start, 0, min(options.max_points, len(start.system.allowed))
    while state.error > options.tolerance and size < largest:
        size = min(max(size + 1, math.ceil((1 + SUPPORT_GROWTH) * size)), largest)
        seen: list[frozenset[int]] = []
        for _ in range(THRESHOLDINGS):
            support = _thresholded(state, size)
            if len(support) == 0 or frozenset(support.tolist()) in seen:
                break
            seen.append(frozenset(support.tolist()))
            state = state.solved_on(support)
            path.record(state)
            if state.error <= options.tolerance:
                break


def uniform(start: Candidates, options: FitOptions, path: PathBuilder) -> None:
    """The floor: points drawn at random in proportion to their volume, each with an equal share of the whole.

    Monte Carlo integration; nothing is fitted, so its error falls with the root of the number of points.
    """
    allowed, weights = start.system.allowed, start.system.forces.point_weights
    rng = np.random.default_rng(options.seed)
    share = weights[allowed] / weights[allowed].sum()
    order = rng.choice(allowed, min(options.max_points, len(allowed)), replace=False, p=share)
    size = 0
    while size < len(order):
        size = min(max(size + 1, math.ceil((1 + SUPPORT_GROWTH) * size)), len(order))
        points = order[:size]
        state = start.given(points, weights.sum() / size / weights[points])
        path.record(state)
        if state.error <= options.tolerance:
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


METHODS: dict[str, Method] = {"exchange": exchange, "ecsw": ecsw, "an": an, "nn_htp": nn_htp, "uniform": uniform}


def fit(system: System, options: FitOptions, tell: Tell | None = None) -> RulePath:
    """The rules of every size that a method finds, down to the tolerance.

    Args:
        system: the terms to fit; the tolerance is for the error of its forces, over all points.
        tell: told the number of points and the relative error after each change.
    """
    path = PathBuilder(tell)
    METHODS[options.method](Candidates.none(system), options, path)
    return path.path(options.tolerance)
