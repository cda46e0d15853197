"""What is given to a simulator, looked at before a step reads it, which would make nonsense of it in silence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ldsim.arrays import Indices
from ldsim.errors import MotionError
from ldsim.mechanics.grabs import Grab, check_within, whole_numbers
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene


def checked_grab(grab: Grab, scene: Scene) -> Grab:
    """A grab as a step reads it.

    Raises:
        MotionError: it is none, or what it holds are not vertices of the solid, each once.
    """
    if not isinstance(grab, Grab):
        raise MotionError(f"a grab is {grab!r}; it must be a Grab(vertices, target, stiffness)")
    return replace(grab, vertices=_vertices(grab.vertices, scene, "a grab"), target=grab.target.copy())


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
    name = f"the vertices of {what}"
    vertices = whole_numbers(given, name)
    check_within(vertices, scene.mesh.n_vertices, name)
    if len(set(vertices.tolist())) < len(vertices):
        raise MotionError(f"{what} has a vertex twice")
    return vertices.astype(np.int64, copy=False)
