"""Residual compliance: what a force moves that the coordinates of a condensed space do not (MacNeal 1971).

To first order a solid whose r coordinates z are held moves by C f under a force f, C = K⁻¹ − T W K⁻¹ at rest. A spring
that pulls at the centroid of some vertices therefore acts in series with C, and what is drawn gains the field of C,
which is local: a dimple where the solid is touched. Where the solid has turned, C has turned with it, and along what
is stretched it is softer (`warp`).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np
from scipy.linalg import polar

from ldsim.arrays import Array, Indices
from ldsim.mechanics.scene import Scene
from ldsim.space.anchors import Anchors
from ldsim.space.basis import Basis
from ldsim.space.relaxation import Relaxation

# Grabs whose fields are kept, nine numbers a vertex each.
REMEMBERED = 64
# What is pressed flat does not get ever stiffer.
LEAST_STRETCH = 0.25


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

    def moved(self, vertices: Indices, u: Array, force: Array) -> Array:
        """What a force on the centroid of some vertices moves, (n, 3) metres, where the coordinates alone give u."""
        A = warp((self.scene.mesh.vertices + u).T @ self.arms(vertices))
        field: Array = self.of_grab(vertices) @ (force @ A) @ A.T
        return field

    def sag(self, gravity: Array | None = None) -> Array:
        """What weight and dead loads move, (n, 3) metres, under some gravity; the scene's where it is left out."""
        if self._sags is None:
            dead = self.scene.force(np.zeros(3))
            weights = self.relaxation.residual(np.stack([self.scene.force(unit) - dead for unit in np.eye(3)]))
            fields = self.relaxation.residual(dead), weights.transpose(1, 2, 0)
            self._sags = self._softness * fields[0], self._softness * fields[1]
        return self._sags[0] + self._sags[1] @ (self.scene.gravity if gravity is None else gravity)

    def between(self, held: Sequence[Indices]) -> Array:
        """B C Bᵀ: what forces on the centroids of some sets of vertices move these centroids, (3g, 3g), m/N."""
        fields = [self.of_grab(vertices) for vertices in held]
        moved = np.block([[field[vertices].mean(axis=0) for field in fields] for vertices in held])
        return np.asarray(0.5 * (moved + moved.T))

    def arms(self, vertices: Indices) -> Array:
        """d, (n, 3) 1/m: with the places y of vertices, Σ y_v ⊗ d_v is F around some vertices, by least squares.

        That is the F whose image of the arms, from the middle of each cell at these vertices to each of its own, is
        nearest to what they are now; the middles fall out, for the arms of a cell add up to nothing.
        """
        mesh = self.scene.mesh
        near = mesh.cells[np.isin(mesh.cells, vertices).any(axis=1)]
        places = mesh.vertices[near]
        arms = np.zeros_like(mesh.vertices)
        np.add.at(arms, near, places - places.mean(axis=1, keepdims=True))
        return arms @ np.linalg.inv(mesh.vertices.T @ arms)


def warp(F: Array) -> Array:
    """A, (3, 3), of a deformation gradient F = R U: C ≈ A C₀ Aᵀ with A = R U^½, U at least `LEAST_STRETCH`.

    What is stretched gives way further to a further pull along the stretch. The power is measured: of 0, 0.3, ½, 0.7
    and 1 a thick soft block was least off with ½ (docs/notebook/2026-11-23-condensed.md, "The lever of a dent").
    """
    R, U = polar(F)
    stretches, axes = np.linalg.eigh(U)
    return np.asarray(R @ (axes * np.sqrt(np.maximum(stretches, LEAST_STRETCH))) @ axes.T)
