"""Motions: what pulls on the solid, frame by frame.

A motion is a sequence of drags, along which gravity may change and pins may move. A drag holds the vertices around the
picked one to a moving target by a spring on their centroid, from one frame to another; which vertices these are is
settled when the drag starts, on the deformed mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

from ldsim.arrays import Array, Indices


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
    point: Array
    targets: Array
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

    vertices: Indices
    maps: Array


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
    gravity: Array | None = None
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
