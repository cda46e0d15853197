"""What a fit is to reach."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ldsim.errors import SolverError


@dataclass(frozen=True)
class Goal:
    """When a fit may stop.

    Attributes:
        tolerance: relative error of the forces to reach.
        max_points: most points of any set.
        volume_weight: weight of the row that asks for the total volume, relative to the forces; 0 leaves it out.
        seed: of the methods that draw candidates.

    Raises:
        SolverError: on a tolerance that is not positive, a limit below 1 or a negative volume weight.
    """

    tolerance: float
    max_points: int
    volume_weight: float = 0.3
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.tolerance > 0:
            raise SolverError(f"cubature tolerance is {self.tolerance:g}; it must be positive, as 0.05")
        if self.max_points < 1:
            raise SolverError(f"cubature max_points is {self.max_points}; it must be at least 1")
        if not 0 <= self.volume_weight < math.inf:
            raise SolverError(
                f"cubature volume_weight is {self.volume_weight:g}; it must be 0 (none) or positive and finite"
            )
