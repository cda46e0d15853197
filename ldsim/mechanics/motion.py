"""Motions: what pulls on the solid, frame by frame.

A motion is a sequence of drags, along which gravity may change and pins may move. A drag holds the vertices around the
picked one to a moving target by a spring on their centroid, from one frame to another; which vertices these are is
settled when the drag starts, on the deformed mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import MotionError
from ldsim.mechanics.scene import Scene


@dataclass(frozen=True, eq=False)
class Drag:
    """One pull of the pointer.

    Attributes:
        start: the first frame of the drag.
        point: where it takes hold, on the deformed solid, (3,) float64, metres.
        targets: the pointer in each frame of the drag, (frames, 3) float64, metres.
        radius: vertices within it of the picked vertex are held, metres.
        stiffness: of the spring on their centroid, N/m.
        at_rest: whether `point` is on the rest shape instead of the deformed one.
    """

    start: int
    point: NDArray[np.float64]
    targets: NDArray[np.float64]
    radius: float
    stiffness: float
    at_rest: bool = False

    @property
    def stop(self) -> int:
        """The first frame after the drag."""
        return self.start + len(self.targets)


@dataclass(frozen=True, eq=False)
class Support:
    """Pinned vertices that move together along a prescribed path, x = A X + b in each frame.

    Attributes:
        vertices: which, (v,) int64.
        maps: (A | b) of each frame, (frames, 3, 4) float64; b in metres.
    """

    vertices: NDArray[np.int64]
    maps: NDArray[np.float64]

    def displacement(self, frame: int, rest: NDArray[np.float64]) -> NDArray[np.float64]:
        """A X + b − X of its vertices, (v, 3) metres, from the rest positions of all, (n, 3)."""
        X = rest[self.vertices]
        u: NDArray[np.float64] = X @ self.maps[frame, :, :3].T + self.maps[frame, :, 3] - X
        return u


class Conditions(NamedTuple):
    """What a motion asks for in one frame besides its grabs.

    Attributes:
        gravity: (3,) float64, m/s²; None for the scene's own.
        prescribed: displacement of every pinned vertex, (p, 3) float64, metres, in the order of `Scene.pinned`; None
            where all pins stand still.
    """

    gravity: NDArray[np.float64] | None = None
    prescribed: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class Motion:
    """What happens to the solid over a number of frames; frame i is the state at time (i + 1) h.

    Attributes:
        drags: pulls of the pointer.
        gravity: acceleration in each frame, (frames, 3) float64, m/s²; None for the scene's own.
        supports: pins that move.
    """

    name: str
    frames: int
    drags: tuple[Drag, ...] = ()
    gravity: NDArray[np.float64] | None = None
    supports: tuple[Support, ...] = ()

    def active(self, frame: int) -> list[int]:
        """The drags that pull in a frame, by number."""
        return [i for i, drag in enumerate(self.drags) if drag.start <= frame < drag.stop]

    def first(self, frames: int) -> Motion:
        """Its first frames, or all where there are fewer."""
        count = min(frames, self.frames)
        return Motion(
            self.name,
            count,
            tuple(drag for drag in self.drags if drag.start < count),
            None if self.gravity is None else self.gravity[:count],
            tuple(Support(support.vertices, support.maps[:count]) for support in self.supports),
        )


@dataclass(frozen=True, eq=False)
class Grab:
    """A drag in one frame: ½ k ‖c(u) − target‖² with c the centroid of the held vertices.

    Attributes:
        vertices: held vertices, (g,) int64.
        target: (3,) float64, metres.
        stiffness: k, N/m.
    """

    vertices: NDArray[np.int64]
    target: NDArray[np.float64]
    stiffness: float


def usual_grip(scene: Scene) -> tuple[float, float]:
    """Stiffness, N/m, and radius, m, of a grab where none are given."""
    return 0.01 * float(scene.mu.mean()) * scene.mesh.diagonal, 0.1 * scene.mesh.diagonal


def held_vertices(
    drag: Drag, positions: NDArray[np.float64], movable: NDArray[np.bool_], reach: float
) -> NDArray[np.int64]:
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


class GrabTracker:
    """Settles each drag's vertices when it starts and hands out the grabs of each frame.

    Args:
        held: vertices already settled, by drag; a drag that is listed is not settled again.
    """

    def __init__(
        self,
        motion: Motion,
        rest: NDArray[np.float64],
        movable: NDArray[np.bool_],
        held: dict[int, NDArray[np.int64]] | None = None,
    ) -> None:
        self._motion = motion
        self._rest = rest
        self._movable = movable
        self._pinned = np.flatnonzero(~movable)
        self._reach = 0.5 * float(np.linalg.norm(np.ptp(rest, axis=0)))
        self.held = dict(held or {})

    def conditions(self, frame: int) -> Conditions:
        """What the motion asks for in a frame besides its grabs."""
        gravity = None if self._motion.gravity is None else self._motion.gravity[frame]
        if not self._motion.supports:
            return Conditions(gravity)
        u = np.zeros_like(self._rest)
        for support in self._motion.supports:
            u[support.vertices] = support.displacement(frame, self._rest)
        return Conditions(gravity, u[self._pinned])

    def needs_state(self, frame: int) -> bool:
        """Whether the deformed mesh is needed to settle a drag that starts in this frame."""
        return any(i not in self.held and not self._motion.drags[i].at_rest for i in self._motion.active(frame))

    def grabs(self, frame: int, u: NDArray[np.float64] | None = None) -> list[Grab]:
        """The grabs of a frame; u, (n, 3) metres, is the displacement before it."""
        result = []
        for i in self._motion.active(frame):
            drag = self._motion.drags[i]
            if i not in self.held:
                positions = self._rest if u is None or drag.at_rest else self._rest + u
                self.held[i] = held_vertices(drag, positions, self._movable, self._reach)
            result.append(Grab(self.held[i], drag.targets[frame - drag.start], drag.stiffness))
        return result
