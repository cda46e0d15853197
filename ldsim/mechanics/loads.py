"""Loads: what acts on the solid in one frame, and how a motion hands them out frame by frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.mechanics.grabs import Grab, held_vertices
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene


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
