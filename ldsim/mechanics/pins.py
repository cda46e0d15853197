"""Pins: which vertices are pinned, and where those are that were moved."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.errors import SceneError
from ldsim.mechanics.regions import Region
from ldsim.mesh.mesh import Mesh


class MovedPins(NamedTuple):
    """Pinned vertices that were moved together, x = A X + b.

    Attributes:
        vertices: which, (v,) int64.
        map: (A | b), (3, 4) float64; b in metres.
    """

    vertices: Indices
    map: Array

    def displacement(self, rest: Array) -> Array:
        """A X + b − X of these vertices, (v, 3) metres, from the rest positions of all, (n, 3)."""
        X = rest[self.vertices]
        return X @ self.map[:, :3].T + self.map[:, 3] - X


def pinned_vertices(mesh: Mesh, regions: Sequence[Region]) -> NDArray[np.bool_]:
    """The vertices in any of the regions, (n,) bool.

    Raises:
        SceneError: a region holds no vertex, or all vertices are pinned.
    """
    pinned = np.zeros(mesh.n_vertices, dtype=bool)
    for region in regions:
        pinned |= region.vertices_in(mesh, "pins")
    if pinned.all():
        raise SceneError(f"the pins hold all {mesh.n_vertices} vertices; at least one must be free to move")
    return pinned
