"""Grabs: a spring on the vertices around a point, and which vertices these are."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldsim.arrays import Array, Indices
from ldsim.errors import MotionError
from ldsim.mechanics.motion import Drag
from ldsim.mechanics.scene import Scene

# What the vertices and the target of a grab mostly are.
ARRAY, WHOLE, REAL = np.ndarray, np.dtype(np.int64), np.dtype(np.float64)


@dataclass(frozen=True, eq=False)
class Grab:
    """A drag in one frame: ½ k ‖c(u) − target‖² with c the centroid of the held vertices.

    Attributes:
        vertices: held vertices, (g,) int64.
        target: (3,) float64, metres.
        stiffness: k, N/m.

    Raises:
        MotionError: vertices that are not whole numbers of 0 or more, or none at all, a target that is not three finite
            numbers, a stiffness that is not positive and finite.
    """

    vertices: Indices
    target: Array
    stiffness: float

    def __post_init__(self) -> None:
        if self._is_usual():
            return
        vertices = whole_numbers(self.vertices, "the vertices of a grab")
        if vertices.min() < 0:
            raise MotionError(
                f"the vertices of a grab are from {vertices.min()} to {vertices.max()}; they must be 0 or more"
            )
        stiffness = np.asarray(self.stiffness)
        if stiffness.ndim or stiffness.dtype.kind not in "iuf" or not 0 < stiffness < inf:
            raise MotionError(f"the stiffness of a grab is {stiffness.tolist()!r}; it must be one positive number, N/m")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "target", checked_vector(self.target, "the target of a grab", "m"))
        object.__setattr__(self, "stiffness", float(stiffness))

    def _is_usual(self) -> bool:
        """Whether all is of the usual types and allowed; in under a microsecond, for every frame makes grabs."""
        vertices, target, stiffness = self.vertices, self.target, self.stiffness
        if not (type(vertices) is ARRAY is type(target) and vertices.dtype is WHOLE and target.dtype is REAL):
            return False
        if vertices.ndim != 1 or not vertices.size or vertices.item(vertices.argmin()) < 0 or target.shape != (3,):
            return False
        x, y, z = target.tolist()
        return isfinite(x) and isfinite(y) and isfinite(z) and isinstance(stiffness, float) and 0 < stiffness < inf


def checked_vector(value: ArrayLike, name: str, unit: str) -> Array:
    """Three finite numbers, (3,) float64.

    Raises:
        MotionError: it is something else.
    """
    vector = np.array(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise MotionError(f"{name} is {vector.tolist()}; it must be three finite numbers in {unit}")
    return vector


def whole_numbers(given: Any, name: str) -> NDArray[np.integer]:
    """Whole numbers, at least one, (v,); the very array that was given where they are in one.

    Raises:
        MotionError: it is something else.
    """
    numbers: NDArray[np.integer] = np.asanyarray(given)
    if numbers.ndim != 1 or not numbers.size or numbers.dtype.kind not in "iu":
        found = f"{numbers.dtype} of the shape {numbers.shape}"
        raise MotionError(f"{name} are {found}; they must be whole numbers, at least one, (v,)")
    return numbers


def check_within(vertices: NDArray[np.integer], count: int, name: str = "the vertices of a grab") -> None:
    """Refuse vertices of another mesh, by a microsecond's work.

    Args:
        vertices: at least one, (v,).
        count: of the mesh's vertices.

    Raises:
        MotionError: one is beyond the mesh.
    """
    least, most = vertices.item(vertices.argmin()), vertices.item(vertices.argmax())
    if least < 0 or most >= count:
        raise MotionError(f"{name} are from {least} to {most}; they must be from 0 to {count - 1}")


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
