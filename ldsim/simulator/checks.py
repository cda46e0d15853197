"""What is given to a simulator, looked at before a step reads it, which would make nonsense of it in silence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ldsim.arrays import Array, Indices
from ldsim.errors import MotionError
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene


def checked_vector(value: ArrayLike, name: str, unit: str) -> Array:
    """Three finite numbers, (3,) float64.

    Raises:
        MotionError: it is something else.
    """
    vector = np.array(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise MotionError(f"{name} is {vector.tolist()}; it must be three finite numbers in {unit}")
    return vector


def checked_grab(grab: Grab, scene: Scene) -> Grab:
    """A grab as a step reads it.

    Raises:
        MotionError: what it holds are not vertices of the solid, each once, or a number is not allowed.
    """
    if not isinstance(grab, Grab):
        raise MotionError(f"a grab is {grab!r}; it must be a Grab(vertices, target, stiffness)")
    stiffness = np.asarray(grab.stiffness)
    if stiffness.ndim or stiffness.dtype.kind not in "iuf" or not 0 < stiffness < np.inf:
        raise MotionError(f"the stiffness of a grab is {stiffness.tolist()!r}; it must be one positive number, N/m")
    vertices = _vertices(grab.vertices, scene, "a grab")
    return Grab(vertices, checked_vector(grab.target, "the target of a grab", "m"), float(stiffness))


def checked_pins(pins: Sequence[MovedPins], scene: Scene) -> tuple[MovedPins, ...]:
    """Moved pins as a step reads them.

    Raises:
        MotionError: what moves are not pinned vertices, each once, or a map is none.
    """
    found, seen = list[MovedPins](), np.zeros(scene.mesh.n_vertices, dtype=bool)
    for moved in pins:
        if not isinstance(moved, MovedPins):
            raise MotionError(f"moved pins are {moved!r}; they must be MovedPins(vertices, map)")
        vertices, map = _vertices(moved.vertices, scene, "moved pins"), np.array(moved.map, dtype=np.float64)
        if map.shape != (3, 4) or not np.isfinite(map).all():
            raise MotionError(f"a map of moved pins is {map.tolist()}; it must be (A | b), (3, 4) finite numbers")
        if not scene.pinned[vertices].all():
            free = int(vertices[~scene.pinned[vertices]][0])
            raise MotionError(f"vertex {free} is to move as pins do, but it is not pinned")
        if seen[vertices].any():
            raise MotionError(f"vertex {int(vertices[seen[vertices]][0])} is moved twice")
        seen[vertices] = True
        # the very array that a motion or the space has is found again at once
        found.append(MovedPins(moved.vertices if isinstance(moved.vertices, np.ndarray) else vertices, map))
    return tuple(found)


def _vertices(given: Any, scene: Scene, what: str) -> Indices:
    vertices, n = np.asarray(given), scene.mesh.n_vertices
    if vertices.ndim != 1 or not vertices.size or vertices.dtype.kind not in "iu":
        found = f"{vertices.dtype} of the shape {vertices.shape}"
        raise MotionError(f"the vertices of {what} are {found}; they must be whole numbers, at least one, (v,)")
    if not 0 <= vertices.min() <= vertices.max() < n:
        raise MotionError(
            f"the vertices of {what} are from {vertices.min()} to {vertices.max()}; they must be from 0 to {n - 1}"
        )
    if len(set(vertices.tolist())) < len(vertices):
        raise MotionError(f"{what} has a vertex twice")
    return vertices if vertices.dtype == np.int64 else vertices.astype(np.int64)
