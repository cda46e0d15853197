"""Residual compliance: what a force moves that the coordinates of a condensed space do not (MacNeal 1971).

To first order a solid whose r coordinates z are held moves by C f under a force f, C = K⁻¹ − T W K⁻¹ at rest. A spring
that pulls at the centroid of some vertices therefore acts in series with C, and what is drawn gains the field of C,
which is local: a dimple where the solid is touched.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.scene import Scene
from ldsim.space.anchors import Anchors
from ldsim.space.basis import Basis
from ldsim.space.relaxation import Relaxation

# Grabs whose fields are kept, nine numbers a vertex each.
REMEMBERED = 64


class Compliance:
    """C of a scene and the coordinates V of a condensed space.

    Its factor is made when it is first needed; `sag` is a call that needs it.
    """

    def __init__(self, scene: Scene, coordinates: Basis) -> None:
        self.scene, self._coordinates = scene, coordinates
        self._relaxation: Relaxation | None = None
        self.anchors: Anchors | None = None
        self._softness = 1.0
        self._known: dict[bytes, Array] = {}
        self._sags: tuple[Array, Array] | None = None

    def of(self, force: Array) -> Array:
        """C f, (n, 3) metres, of a force (n, 3), N."""
        if self.anchors is not None:
            return self._softness * self.anchors.residual(force)
        return self._softness * self.relaxation.residual(force)

    @property
    def relaxation(self) -> Relaxation:
        """What C is made of at rest: the factor of K, W and T."""
        if self._relaxation is None:
            self._relaxation = Relaxation(self.scene, self._coordinates)
        return self._relaxation

    def stiffened(self, scale: float) -> Compliance:
        """That of the same solid with its Lamé parameters times a positive number: K₀ times it, so C divided by it."""
        other = copy(self)
        other._softness, other._known, other._sags = self._softness / scale, {}, None
        return other

    def anchored(self, anchors: Anchors | None = None) -> Compliance:
        """The same, kept at anchors, as the C library has it: grabs cost no solves. What weight moves stays exact."""
        if self.anchors is not None:
            return self
        self.sag()
        other = copy(self)
        other.anchors, other._known = Anchors.of(self.relaxation) if anchors is None else anchors, {}
        return other

    def of_grab(self, vertices: Indices) -> Array:
        """What a unit force on the centroid of some vertices moves, by axis of the force, (n, 3, 3), m/N."""
        key = vertices.tobytes()
        if key not in self._known:
            if len(self._known) >= REMEMBERED:
                self._known.pop(next(iter(self._known)))
            n = self.scene.mesh.n_vertices
            force = np.zeros((3, n, 3))
            for axis in range(3):
                force[axis, vertices, axis] = 1 / len(vertices)
            self._known[key] = np.stack([self.of(f) for f in force], axis=2)
        return self._known[key]

    def sag(self, gravity: Array | None = None) -> Array:
        """What weight and dead loads move, (n, 3) metres, under some gravity; the scene's where it is left out."""
        if self._sags is None:
            dead = self.scene.force(np.zeros(3))
            weights = self.relaxation.residual(np.stack([self.scene.force(unit) - dead for unit in np.eye(3)]))
            fields = self.relaxation.residual(dead), weights.transpose(1, 2, 0)
            self._sags = self._softness * fields[0], self._softness * fields[1]
        return self._sags[0] + self._sags[1] @ (self.scene.gravity if gravity is None else gravity)

    def stiffness(self, grabs: Sequence[Grab]) -> Array:
        """(diag(1/k) + B C Bᵀ)⁻¹ of some grabs together, (3g, 3g), N/m."""
        flexible = np.diag(np.repeat([1 / grab.stiffness for grab in grabs], 3))
        for j, other in enumerate(grabs):
            fields = self.of_grab(other.vertices)
            for i, grab in enumerate(grabs):
                flexible[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] += fields[grab.vertices].mean(axis=0)
        return np.asarray(np.linalg.inv(0.5 * (flexible + flexible.T)), dtype=np.float64)
