"""Loads: what acts on the solid in one frame, and how a motion hands them out frame by frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import MotionError
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.scene import Scene

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


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
        u: Array = X @ self.map[:, :3].T + self.map[:, 3] - X
        return u


class Loads(NamedTuple):
    """What acts in one frame.

    Attributes:
        grabs: springs that pull.
        gravity: (3,) float64, m/s²; None for the scene's own.
        pins: where moved pins are; all others are at rest.
    """

    grabs: tuple[Grab, ...] = ()
    gravity: Array | None = None
    pins: tuple[MovedPins, ...] = ()


NONE = Loads()


class MotionLoads:
    """Hands out the loads of a motion frame by frame, and settles each drag's vertices when it starts.

    Args:
        held: vertices already settled, by drag; a drag that is listed is not settled again.

    Attributes:
        held: vertices of each drag so far.
    """

    def __init__(self, motion: Motion, scene: Scene, held: dict[int, Indices] | None = None) -> None:
        self._motion, self._rest, self._movable = motion, scene.mesh.vertices, scene.movable
        self._reach = 0.5 * float(np.linalg.norm(np.ptp(self._rest, axis=0)))
        self.held = dict(held or {})

    def needs_state(self, frame: int) -> bool:
        """Whether the deformed mesh is needed to settle a drag that starts in this frame."""
        return any(i not in self.held and not self._motion.drags[i].at_rest for i in self._motion.active(frame))

    def at(self, frame: int, u: Array | None = None) -> Loads:
        """The loads of a frame; u, (n, 3) metres, is the displacement before it.

        Raises:
            MotionError: a drag that starts here is not near the solid, or holds pinned vertices alone.
        """
        motion, grabs = self._motion, []
        for i in motion.active(frame):
            drag = motion.drags[i]
            if i not in self.held:
                positions = self._rest if u is None or drag.at_rest else self._rest + u
                self.held[i] = held_vertices(drag, positions, self._movable, self._reach)
            grabs.append(Grab(self.held[i], drag.targets[frame - drag.start], drag.stiffness))
        gravity = None if motion.gravity is None else motion.gravity[frame]
        return Loads(tuple(grabs), gravity, self.pins(frame))

    def pins(self, frame: int) -> tuple[MovedPins, ...]:
        """Where moved pins are in a frame."""
        return tuple(MovedPins(support.vertices, support.maps[frame]) for support in self._motion.supports)


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
