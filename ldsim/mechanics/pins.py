"""Supports: which vertices do not move."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import SceneError

AXES = {"x": 0, "y": 1, "z": 2}


class Pin(ABC):
    """A region whose vertices are pinned."""

    @abstractmethod
    def holds(self, vertices: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each rest position, (n, 3) metres, is pinned; (n,) bool."""


@dataclass(frozen=True)
class Slab(Pin):
    """The vertices within `thickness` metres of the smallest (or largest) coordinate on an axis."""

    axis: str
    at_max: bool
    thickness: float

    def holds(self, vertices: NDArray[np.float64]) -> NDArray[np.bool_]:
        x = vertices[:, AXES[self.axis]]
        inside: NDArray[np.bool_] = x >= x.max() - self.thickness if self.at_max else x <= x.min() + self.thickness
        return inside


@dataclass(frozen=True)
class Ball(Pin):
    """The vertices within `radius` metres of `centre`."""

    centre: tuple[float, float, float]
    radius: float

    def holds(self, vertices: NDArray[np.float64]) -> NDArray[np.bool_]:
        inside: NDArray[np.bool_] = np.linalg.norm(vertices - np.array(self.centre), axis=1) <= self.radius
        return inside


def pinned_vertices(vertices: NDArray[np.float64], pins: Sequence[Pin]) -> NDArray[np.bool_]:
    """The vertices that any of the pins holds, (n,) bool.

    Raises:
        SceneError: a pin holds nothing, or all vertices are pinned.
    """
    pinned = np.zeros(len(vertices), dtype=bool)
    for pin in pins:
        held = pin.holds(vertices)
        if not held.any():
            low, high = vertices.min(axis=0).round(4).tolist(), vertices.max(axis=0).round(4).tolist()
            raise SceneError(f"{pin} pins no vertex; the solid spans {low} … {high} m")
        pinned |= held
    if pinned.all():
        raise SceneError(f"the pins hold all {len(vertices)} vertices; at least one must be free to move")
    return pinned
