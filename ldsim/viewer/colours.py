"""Energy and stress as colours, now and then, on a scale that is held."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np

from ldsim.mechanics.scene import Scene
from ldsim.mesh.surface import Surface
from ldsim.simulator import Simulator
from ldsim.simulator.fields import FIELDS, VertexField
from ldsim.viewer.payload import field_bytes

# Seconds between two.
EVERY = 0.1
NAMES = ("plain", "displacement", *FIELDS, "novelty")


class Colours:
    """What the server computes of what the page may show; the page does the others by itself."""

    def __init__(self, scene: Scene, surface: Surface) -> None:
        self._field = VertexField(scene, surface.vertices)
        self._field(FIELDS[0], np.zeros((scene.mesh.n_vertices, 3)), 1.0)  # compiled now, before a page waits for it
        self.start()

    def start(self) -> None:
        """A colour is chosen: its scale begins anew."""
        self._time, self._high = 0.0, 0.0

    def of(self, field: str, shown: Sequence[Simulator]) -> list[bytes]:
        """A block for every space where it is time for one and the server computes it; else none."""
        if field not in FIELDS or time.perf_counter() - self._time <= EVERY:
            return []
        self._time = time.perf_counter()
        values = [self._field(field, each.displacement(), each.material_scale) for each in shown]
        # an inverted cell has no finite energy, and is drawn as the most there is
        finite = [each[np.isfinite(each)] for each in values]
        largest = max((float(np.percentile(each, 99)) for each in finite if each.size), default=0.0)
        if largest > self._high:  # it grows by round steps, and does not shrink
            self._high = rounded_up(largest)
        return [field_bytes(i, each, 0.0, self._high) for i, each in enumerate(values)]


def rounded_up(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value)) if value > 0 else 0.0
    return next((step * power for step in (1, 2, 5) if step * power >= value), 10 * power)
