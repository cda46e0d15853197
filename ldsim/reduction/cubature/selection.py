"""Which snapshots the cubature is fitted to, and which are kept back to judge it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.reduction.cubature.fit import CubatureFit, Progress, fit, relative_error
from ldsim.reduction.cubature.forces import ProjectedForces

Indices = NDArray[np.int64]


def split_poses(frames: int, fitted: int, kept_back: int, seed: int) -> tuple[Indices, Indices]:
    """Two disjoint random choices of frames, each rising.

    Raises:
        SolverError: there are fewer frames than asked for.
    """
    if frames < fitted + kept_back:
        raise SolverError(
            f"cubature needs {fitted} poses to fit and {kept_back} to judge, but there are {frames} training frames; "
            "lower cubature.poses or cubature.heldout_poses, or record more"
        )
    order = np.random.default_rng(seed).permutation(frames)
    return np.sort(order[:fitted]), np.sort(order[fitted : fitted + kept_back])


def fit_and_judge(
    make: Callable[[Indices], ProjectedForces],
    fitted: Indices,
    kept_back: Indices,
    tolerance: float,
    max_points: int,
    progress: Progress | None = None,
) -> tuple[CubatureFit, NDArray[np.float64]]:
    """Fit to some poses and give the relative error of every set of the ladder on others, (l,)."""
    result = fit(make(fitted), tolerance, max_points, progress=progress)
    judge = make(kept_back)
    return result, np.array([relative_error(judge, entry) for entry in result.ladder])
