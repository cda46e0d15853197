"""A fit of cubature points and weights to reduced forces, by any of the methods."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.candidates import Candidates, System
from ldsim.cubature.exchange import exchange
from ldsim.cubature.goal import Goal
from ldsim.cubature.ladder import CubatureFit, Ladder, Progress
from ldsim.cubature.methods import an, ecsw, nn_htp, uniform
from ldsim.cubature.rows import Rows

Indices = NDArray[np.int64]
Method = Callable[[Candidates, Goal, Ladder], None]

METHODS: dict[str, Method] = {"exchange": exchange, "ecsw": ecsw, "an": an, "nn_htp": nn_htp, "uniform": uniform}


def fit(
    forces: Rows,
    goal: Goal,
    method: str = "exchange",
    *,
    others: tuple[tuple[Rows, float], ...] = (),
    candidates: Indices | None = None,
    progress: Progress | None = None,
) -> CubatureFit:
    """The smallest cubature set found whose relative error of the forces is at most the tolerance.

    Args:
        forces: the projected forces of the training poses.
        method: a name of `METHODS`.
        others: more rows to fit, each with its weight relative to the forces (`rows.ForceChanges`, `rows.Energies`).
        candidates: the points that may be chosen, (c,); None for all. The error is that over all points either way.
        progress: told the number of points and the relative error after each change.
    """
    ladder = Ladder(progress)
    METHODS[method](Candidates.none(System(forces, goal.volume_weight, others, candidates)), goal, ladder)
    return ladder.result(goal.tolerance)
