"""Grabs: a spring on the vertices around a point, and which vertices these are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.errors import MotionError
from ldsim.mechanics.motion import Drag
from ldsim.mechanics.scene import Scene


@dataclass(frozen=True, eq=False)
class Grab:
    """A drag in one frame: ½ k ‖c(u) − target‖² with c the centroid of the held vertices.

    Attributes:
        vertices: held vertices, (g,) int64.
        target: (3,) float64, metres.
        stiffness: k, N/m.
    """

    vertices: Indices
    target: Array
    stiffness: float


def usual_grip(scene: Scene) -> tuple[float, float]:
    """Stiffness, N/m, and radius, m, of a grab where none are given."""
    return 0.01 * float(scene.mu.mean()) * scene.mesh.diagonal, 0.1 * scene.mesh.diagonal


def held_vertices(drag: Drag, positions: Array, movable: NDArray[np.bool_], reach: float) -> Indices:
    """The vertices a drag takes hold of: those within its radius of the vertex nearest to its point.

    A recording made on a coarser or softer mesh has drifted away from this one by centimetres (0.046 m in x_1), so the
    nearest vertex is taken up to the given reach.

    Args:
        positions: deformed vertex positions, (n, 3) float64, metres.
        movable: false for pinned vertices, (n,) bool.
        reach: the largest distance from the drag's point to a vertex, metres.

    Raises:
        MotionError: the nearest vertex is beyond reach, or everything near is pinned.
    """
    distance = np.linalg.norm(positions - drag.point, axis=1)
    picked = int(distance.argmin())
    if distance[picked] > reach:
        raise MotionError(
            f"the grab at frame {drag.start} hits no vertex: the nearest is {distance[picked]:.4g} m from "
            f"{np.round(drag.point, 4).tolist()}, allowed are {reach:.4g} m (half the solid's diagonal); "
            "check that the motion belongs to this mesh and that both are in metres"
        )
    near = np.linalg.norm(positions - positions[picked], axis=1) <= drag.radius
    held = np.flatnonzero(near & movable)
    if len(held) == 0:
        raise MotionError(
            f"the grab at frame {drag.start} holds only pinned vertices around {np.round(drag.point, 4).tolist()}; "
            "grab a part that can move"
        )
    return held
