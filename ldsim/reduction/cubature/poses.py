"""Where the poses of a cubature fit come from: decoded coordinates, or true displacements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import SolverError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Poses(Protocol):
    """Displacements by the number of the pose."""

    def whole(self, t: int) -> Array:
        """Pose t, (n, 3) float64, metres."""
        ...

    def at(self, vertices: Indices) -> Callable[[int], Array]:
        """The function t → pose t at some vertices, (v, 3) float64, metres."""
        ...


@dataclass(frozen=True, eq=False)
class DecodedPoses:
    """u_t = U q_t for a basis U (3n, k) and outer coordinates q (T, k)."""

    U: Array
    q: Array

    def whole(self, t: int) -> Array:
        u: Array = (self.U @ self.q[t]).reshape(-1, 3)
        return u

    def at(self, vertices: Indices) -> Callable[[int], Array]:
        rows = np.ascontiguousarray(self.U.reshape(-1, 3, self.U.shape[1])[vertices])
        return lambda t: rows @ self.q[t]


@dataclass(frozen=True, eq=False)
class TruePoses:
    """Poses read by a function t → (n, 3), metres; every reading is checked, for the compiled loops do not."""

    displacement: Callable[[int], Array]
    n_vertices: int

    def whole(self, t: int) -> Array:
        u = np.ascontiguousarray(self.displacement(t), dtype=np.float64)
        if u.shape != (self.n_vertices, 3):
            raise SolverError(
                f"cubature: displacement of pose {t} has shape {u.shape}; expected ({self.n_vertices}, 3)"
            )
        return u

    def at(self, vertices: Indices) -> Callable[[int], Array]:
        return lambda t: self.whole(t)[vertices]
