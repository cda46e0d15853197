"""What solves with the sparse matrix of a step, whichever way it does."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray


class LinearSolver(ABC):
    """An (approximate) inverse of a symmetric positive definite matrix."""

    @abstractmethod
    def solve(self, right: NDArray[np.float64]) -> NDArray[np.float64]:
        """x with A x ≈ right, (3f,) float64."""
