"""Motions: what pulls on the solid, frame by frame.

A motion is a sequence of drags, along which gravity may change and pins may move. A drag holds the vertices around the
picked one to a moving target by a spring on their centroid, from one frame to another; which vertices these are is
settled when the drag starts, on the deformed mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.errors import MotionError


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

    Raises:
        MotionError: a number that is not finite, a negative start or radius, a stiffness that is not positive.
    """

    start: int
    point: Array
    targets: Array
    radius: float
    stiffness: float
    at_rest: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.stiffness < np.inf or not 0 <= self.radius < np.inf:
            raise MotionError(
                f"a grab of stiffness {self.stiffness:g} N/m and radius {self.radius:g} m; "
                "the stiffness must be positive, the radius not negative, both finite"
            )
        if self.start < 0 or not (np.isfinite(self.point).all() and np.isfinite(self.targets).all()):
            raise MotionError(f"the grab at frame {self.start} has a negative start, or places that are not finite")

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

    Raises:
        MotionError: a map that is not finite.
    """

    vertices: Indices
    maps: Array

    def __post_init__(self) -> None:
        if not np.isfinite(self.maps).all():
            raise MotionError("moving pins follow a path that is not finite")


@dataclass(frozen=True, eq=False)
class Motion:
    """What happens to the solid over a number of frames; frame i is the state at time (i + 1) h.

    Attributes:
        drags: pulls of the pointer.
        gravity: acceleration in each frame, (frames, 3) float64, m/s²; None for the scene's own.
        supports: pins that move.

    Raises:
        MotionError: gravity that is not finite, or a path of another number of frames.
    """

    name: str
    frames: int
    drags: tuple[Drag, ...] = ()
    gravity: Array | None = None
    supports: tuple[Support, ...] = ()

    def __post_init__(self) -> None:
        lengths = {len(support.maps) for support in self.supports}
        if self.gravity is not None:
            lengths.add(len(self.gravity))
            if not np.isfinite(self.gravity).all():
                raise MotionError(f"motion {self.name!r} has a gravity that is not finite")
        if lengths - {self.frames}:
            raise MotionError(f"motion {self.name!r} has {self.frames} frames, its paths {sorted(lengths)}")

    def active(self, frame: int) -> tuple[int, ...]:
        """The drags that pull in a frame, by number; none outside of the motion's frames."""
        return self._active[frame] if 0 <= frame < self.frames else ()

    @cached_property
    def _active(self) -> list[tuple[int, ...]]:
        # once for all frames: a motion of a thousand pulls would look at each of them in every frame
        found: list[list[int]] = [[] for _ in range(self.frames)]
        for i, drag in enumerate(self.drags):
            for frame in range(drag.start, min(drag.stop, self.frames)):
                found[frame].append(i)
        return [*map(tuple, found)]

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
