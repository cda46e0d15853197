"""Residual compliance: what a force moves that the coordinates of a condensed space do not (MacNeal 1971).

To first order a solid whose r coordinates z are held moves by C f under a force f, C = K⁻¹ − T W K⁻¹ at rest. A spring
that pulls at the centroid of some vertices therefore acts in series with C, and what is drawn gains the field of C,
which is local: a dimple where the solid is touched. Where the solid has turned, C has turned with it, and along what
is stretched it is softer (`warp`). To the next order it changes with the coordinates and with the force itself, by the
third derivative of the elastic energy (`Dent`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from threading import Lock
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.linalg import polar

from ldsim.arrays import Array, Indices
from ldsim.jit import njit
from ldsim.mechanics.elastic import PAIRS, third_derivative
from ldsim.mechanics.scene import Scene
from ldsim.space.anchors import Anchors
from ldsim.space.basis import Basis
from ldsim.space.modes import Modes
from ldsim.space.relaxation import Relaxation

# Grabs whose fields are kept, up to 36 numbers a vertex each.
REMEMBERED = 64
ROOM = Lock()
Kept = TypeVar("Kept")
# What is pressed flat does not get ever stiffer.
LEAST_STRETCH = 0.25
# Most that a force, or the coordinates beside warping, change the compliance, a share of it.
MOST_CHANGED = 0.5
# Turned so far, rad, nothing of the coupling is left.
TURNED = 0.4
# Which of `PAIRS` an entry of a symmetric matrix is.
MATRIX = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


class Compliance:
    """C of a scene and the coordinates V of a condensed space, less that of modes that swing and do not turn.

    What modes have of C is of it where it turns with the place that is held (`Modes.turns`). The factor of K is made
    when it is first needed; `sag` is a call that needs it.
    """

    def __init__(self, scene: Scene, coordinates: Basis, modes: Modes | None = None) -> None:
        self.scene, self._coordinates, self.modes = scene, coordinates, modes
        self._relaxation: Relaxation | None = None
        self.anchors: Anchors | None = None
        self._softness = 1.0
        self._known: dict[bytes, Array] = {}
        self._dents: dict[bytes, Dent] = {}
        self._fields: dict[bytes, Array] = {}
        self._last_bent: tuple[bytes, Array] | None = None
        self._sags: tuple[tuple[Array, Array], ...] = ()

    def of(self, force: Array) -> Array:
        """C f, (…, n, 3) metres, of forces (…, n, 3), N."""
        found = self.local(force) if self.anchors is None else self.anchors.residual(force)
        if self.modes is not None and self.modes.turns:
            found = found + self.modes.moved(force)
        return self._softness * found

    def local(self, force: Array) -> Array:
        """What of C f modes that swing have no part in, of the solid that is not stiffened, without anchors."""
        found = self.relaxation.residual(force)
        return found if self.modes is None else found - self.modes.moved(force)

    @property
    def relaxation(self) -> Relaxation:
        """What C is made of at rest: the factor of K, W and T."""
        if self._relaxation is None:
            self._relaxation = Relaxation(self.scene, self._coordinates)
        return self._relaxation

    def stiffened(self, scale: float) -> Compliance:
        """That of the same solid with its Lamé parameters times a positive number: K₀ times it, so C divided by it."""
        other = self._without_grabs()
        other._softness, other._sags = self._softness / scale, ()
        return other

    def anchored(self, anchors: Anchors | None = None) -> Compliance:
        """The same, kept at anchors, as the C library has it: grabs cost no solves. What weight moves stays exact."""
        if self.anchors is not None:
            return self
        self.sag()
        other = self._without_grabs()
        other.anchors = anchors or Anchors.of(self.scene, self.local)
        return other

    def _without_grabs(self) -> Compliance:
        other = copy(self)
        other._known, other._dents, other._fields, other._last_bent = {}, {}, {}, None
        return other

    def of_grab(self, vertices: Indices) -> Array:
        """What a unit force on the centroid of some vertices moves, by axis of the force, (n, 3, 3), m/N."""
        return _remembered(self._known, vertices, self._of_grab)

    def _of_grab(self, vertices: Indices) -> Array:
        force = np.zeros((3, self.scene.mesh.n_vertices, 3))
        for axis in range(3):
            force[axis, vertices, axis] = 1 / len(vertices)
        return np.ascontiguousarray(self.of(force).transpose(1, 2, 0))

    def dent(self, vertices: Indices) -> Dent:
        """What a force on the centroid of some vertices does to the centroid itself.

        Fields that are kept at anchors are too smooth for third derivatives: there the dent stays linear.
        """
        return _remembered(self._dents, vertices, self._dent)

    def _dent(self, vertices: Indices) -> Dent:
        fields, T = self.of_grab(vertices), self.relaxation.rest.tangents
        C, second, coupling = fields[vertices].mean(axis=0), np.zeros((3, 3, 3)), np.zeros((T.shape[2], 3, 3))
        if self.anchors is None:
            forces = self._bending(vertices)[:, :, MATRIX] / self._softness
            second = np.einsum("vaij,vak->ijk", forces, fields)
            # warping has some of it
            L = np.einsum("vij,vk->jik", T, self.arms(vertices))
            warped = (0.75 * L - 0.25 * L.transpose(0, 2, 1)) @ C
            coupling = np.einsum("vaij,vak->kij", forces, T) - warped - warped.transpose(0, 2, 1)
        return Dent.of(C, second, coupling)

    def fields(self, vertices: Indices) -> Array:
        """What a dent is made of, by `Dent.amounts`, (n, 3, 9): m/N of unit forces, then m/N² of their pairs.

        Where the dent is linear only the former, (n, 3, 3).
        """
        if self.dent(vertices).linear:
            return self.of_grab(vertices)
        return _remembered(self._fields, vertices, self._with_pairs)

    def _with_pairs(self, vertices: Indices) -> Array:
        pairs = self.of(self._bending(vertices).transpose(2, 0, 1)) / self._softness
        return np.concatenate([self.of_grab(vertices), pairs.transpose(1, 2, 0)], axis=2)

    def _bending(self, vertices: Indices) -> Array:
        """Minus ∂³V/∂u³ along what unit forces move, of the solid that is not stiffened, (n, 3, 6)."""
        key = vertices.tobytes()
        last = self._last_bent
        if last is None or last[0] != key:  # a grab asks twice, for its dent and for its fields
            last = self._last_bent = key, -third_derivative(self.scene.elements, self.of_grab(vertices))
        return last[1]

    def moved(self, vertices: Indices, u: Array, force: Array) -> Array:
        """What a force on the centroid of some vertices moves, (n, 3) metres, where the coordinates alone give u."""
        F, dent = (self.scene.mesh.vertices + u).T @ self.arms(vertices), self.dent(vertices)
        A, share = warp(F), unturned(float(np.trace(polar(F)[0])))
        amounts = dent.amounts(force @ A, dent.change(share, self.relaxation.encode(u[None])[0]))
        field: Array = self.fields(vertices) @ amounts @ A.T
        return field

    def sag(self, gravity: Array | None = None, local: bool = False) -> Array:
        """What weight and dead loads move, (n, 3) metres, under some gravity; the scene's where it is left out.

        Args:
            local: of that what modes that swing have no part in.
        """
        dead, weight = self.sags(local)
        return dead + weight @ (self.scene.gravity if gravity is None else gravity)

    def sags(self, local: bool = False) -> tuple[Array, Array]:
        """What dead loads move, (n, 3) metres, and unit gravity along each axis, (n, 3, 3) s²."""
        if not self._sags:
            dead = self.scene.force(np.zeros(3))
            forces = np.stack([dead, *(self.scene.force(unit) - dead for unit in np.eye(3))])
            both = (self._softness * moved for moved in (self.relaxation.residual(forces), self.local(forces)))
            self._sags = tuple((moved[0], moved[1:].transpose(1, 2, 0)) for moved in both)
        return self._sags[local]

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


class Dent(NamedTuple):
    """What a force f at one grab moves its centroid by, d = (C + N z) f + ½ D(f, f), in the solid's frame at rest.

    The complementary energy to third order: D is minus ∂³V/∂u³ along what unit forces move, and N beside what warping
    gives, minus that along two of these and the tangents at rest. Beyond changes of C by `MOST_CHANGED`, in the
    Frobenius norm of C^-½ N z C^-½ and C^-½ D(f) C^-½, the law goes on along its tangent there: the next orders are not
    known, and a compliance has to stay positive.

    Attributes:
        compliance: C, (3, 3) m/N.
        coupling: N, (r, 3, 3) m/N by coordinate.
        second: D, symmetric, (3, 3, 3) m/N².
        root: C^-½, (3, 3).
    """

    compliance: Array
    coupling: Array
    second: Array
    root: Array

    @classmethod
    def of(cls, compliance: Array, second: Array, coupling: Array) -> Dent:
        """That of C, D and N."""
        values, axes = np.linalg.eigh(0.5 * (compliance + compliance.T))
        # what hardly gives way has no dent to speak of
        roots = np.where(values > 1e-9 * abs(values).max(), np.abs(values), np.inf) ** -0.5
        return cls(compliance, coupling, second, (axes * roots) @ axes.T)

    @property
    def linear(self) -> bool:
        """Whether it is C f alone."""
        return not (self.second.any() or self.coupling.any())

    def amounts(self, force: Array, change: Array) -> Array:
        """How much of each of `Compliance.fields` a force (3,), N, makes where C has changed: (9,), N and N²."""
        if self.linear:
            return force
        # the force whose dent at rest is as large as that of this one, to first order
        single = force + self.root @ self.root @ change @ force
        at = self._limit(self.second @ force) * force
        pairs = np.outer(at, force - 0.5 * at)
        return np.concatenate([single, [pairs[i, j] if i == j else pairs[i, j] + pairs[j, i] for i, j in PAIRS]])

    def change(self, share: float, z: Array) -> Array:
        """A share of N z, or less, (3, 3) m/N."""
        change = np.tensordot(z, self.coupling, 1)
        return np.asarray(share * self._limit(change) * change)

    def _limit(self, change: Array) -> float:
        """How much of a change of C is taken, at most 1."""
        size = float(np.linalg.norm(self.root @ change @ self.root))
        return min(1.0, MOST_CHANGED / size) if size > 0 else 1.0


def _remembered(known: dict[bytes, Kept], vertices: Indices, make: Callable[[Indices], Kept]) -> Kept:
    """What is known of a grab, made where it is not; of many grabs the first is forgotten. Threads share all of it."""
    key = vertices.tobytes()
    found = known.get(key)
    if found is None:
        found = make(vertices)  # not under the lock, for it takes long; if two threads make the same, the last is kept
        with ROOM:
            if len(known) >= REMEMBERED:
                del known[next(iter(known))]
            known[key] = found
    return found


@njit(cache=True)
def unturned(trace: float) -> float:
    """What share of N z holds where a place has turned, by the trace of its rotation R, 1 + 2 cos θ.

    N is of strains, and linear coordinates see strain in what has only turned, ½ θ² of it.
    """
    return max(1 - (3 - trace) / TURNED**2, 0.0) ** 2


def warp(F: Array) -> Array:
    """A, (3, 3), of a deformation gradient F = R U: C ≈ A C₀ Aᵀ with A = R U^½, U at least `LEAST_STRETCH`.

    What is stretched gives way further to a further pull along the stretch. The power is measured: of 0, 0.3, ½, 0.7
    and 1 a thick soft block was least off with ½ (docs/notebook/2026-11-23-condensed.md, "The lever of a dent").
    """
    R, U = polar(F)
    stretches, axes = np.linalg.eigh(U)
    return np.asarray(R @ (axes * np.sqrt(np.maximum(stretches, LEAST_STRETCH))) @ axes.T)
