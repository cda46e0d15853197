"""Supports: which vertices are pinned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import SceneError
from ldsim.mechanics.regions import Region
from ldsim.mesh.mesh import Mesh


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
