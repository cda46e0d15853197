"""A solid of the C library that does what the loads of each frame say, as a stepper in Python does."""

from __future__ import annotations

import numpy as np

from ldsim.mechanics.loads import Loads
from ldsim.runtime.library import NativeSolid
from ldsim.space.space import Space


class Follower:
    """Grabs, lets go, tips gravity and moves pins so that they are those of the loads, then steps.

    Args:
        space: that the solid's model was written from.
    """

    def __init__(self, solid: NativeSolid, space: Space) -> None:
        self.solid, self._own_gravity, self._gravity = solid, space.scene.gravity, space.scene.gravity
        self._supports = () if space.lifting is None else space.lifting.supports
        self._held: dict[bytes, int] = {}

    def step(self, acting: Loads) -> int:
        """One step under some loads; its iterations."""
        self.take(acting)
        return self.solid.step()[0]

    def take(self, acting: Loads) -> None:
        """What acts in the next step."""
        solid, wanted = self.solid, {grab.vertices.tobytes(): grab for grab in acting.grabs}
        for key in [key for key in self._held if key not in wanted]:
            solid.release(self._held.pop(key))
        for key, grab in wanted.items():
            if key in self._held:
                solid.move(self._held[key], grab.target)
            else:
                self._held[key] = solid.grab_vertices(grab.vertices, grab.target, grab.stiffness)
        gravity = self._own_gravity if acting.gravity is None else acting.gravity
        if not np.array_equal(gravity, self._gravity):  # it costs a condensed model new springs
            solid.set_gravity(gravity)
            self._gravity = gravity
        maps = {pins.vertices.tobytes(): pins.map for pins in acting.pins}
        for i, vertices in enumerate(self._supports):
            solid.move_pins(i, maps.get(vertices.tobytes(), np.eye(3, 4)))
