"""What a thread works with: the springs of what is held, the model under the present loads, scratch memory."""

from __future__ import annotations

from collections.abc import Sequence
from operator import is_
from typing import NamedTuple

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.dynamics.reduced.advance import StepReference, step_reference
from ldsim.dynamics.reduced.in_series import InSeries, centres
from ldsim.dynamics.reduced.minimiser import Minimisation
from ldsim.dynamics.reduced.potential import Reduced, Springs, make_work
from ldsim.mechanics.grabs import Grab, check_within
from ldsim.space.space import Space


class Unloaded(NamedTuple):
    """A model and springs that somebody else fills with what acts, and the reference by which a step reads both."""

    model: Reduced
    springs: Springs
    reference: StepReference


class Workspace:
    """What one thread works with: a model whose force may change, the springs of the last grabs, scratch memory."""

    def __init__(self, model: Reduced, minimisation: Minimisation, space: Space) -> None:
        self.model, self._minimisation, self._space = model, minimisation, space
        self.work = make_work(space.decoder, len(model.weights))
        self.other_gravity = False
        self.held: tuple[Indices, ...] = ()
        # of the grabs of a condensed space, and the gravity and stiffnesses that it was made for
        self.series = self._loose = InSeries.none(model.force.shape[0], len(model.squares))
        self._made_for: tuple[Array | None, list[float]] = (None, [])
        self._dents: Array | None = None
        self._sag: tuple[Array | None, float] | None = None
        self.springs = self._springs(())
        self.reference = self._reference()

    def grab(self, grabs: Sequence[Grab], gravity: Array | None) -> None:
        """Hold what the grabs hold; what is kept serves while they hold the same."""
        held = [grab.vertices for grab in grabs]
        other = not same_arrays(held, self.held)
        if other:
            self.springs, self.held, self.series = self._springs(grabs), tuple(held), self._loose
            self._dents = None
            self.reference = self._reference()
        if self._space.is_condensed and grabs:
            self._grab_in_series(grabs, gravity)
            return
        _, _, target, stiffness = self.springs
        for i, grab in enumerate(grabs):
            target[i] = grab.target
            stiffness[i] = grab.stiffness

    def _grab_in_series(self, grabs: Sequence[Grab], gravity: Array | None) -> None:
        stiffness = [grab.stiffness for grab in grabs]
        if self.series is self._loose or self._made_for[1] != stiffness:
            self._made_for = gravity, stiffness
            self.series = InSeries.of(self._space, grabs, gravity)
            self.springs.stiffness[:] = 1.0
            self.reference = self._reference()
        elif not _same_gravity(self._made_for[0], gravity):  # which moves the centres and nothing else
            self._made_for = gravity, stiffness
            self.series.centre[:] = centres(self._space, grabs, gravity)
        for i, grab in enumerate(grabs):
            self.series.target[3 * i : 3 * i + 3] = grab.target

    def dents(self) -> Array:
        """Products in the mass of the fields of each dent, (g, 9, 9): how far they move a condensed solid.

        Where a dent is linear what is of pairs is zero.
        """
        compliance, mass = self._space.compliance, self._space.scene.mass
        if self._dents is None and compliance is not None:
            self._dents = np.zeros((len(self.held), 9, 9))
            for products, vertices in zip(self._dents, self.held, strict=True):
                fields = compliance.fields(vertices)
                moved = np.asarray(mass @ fields.reshape(len(fields), -1)).reshape(fields.shape)
                count = fields.shape[2]
                products[:count, :count] = np.einsum("nij,nik->jk", fields, moved)
        return np.zeros((0, 9, 9)) if self._dents is None else self._dents

    def sag(self, gravity: Array | None) -> float:
        """How far weight moves a condensed solid beside its coordinates, in the mass norm, kg^½ m."""
        if self._sag is None or not _same_gravity(self._sag[0], gravity):
            compliance = self._space.compliance
            u = np.zeros((0, 3)) if compliance is None else compliance.sag(gravity, local=True)
            self._sag = gravity, float(np.sqrt(np.vdot(u, self._space.scene.mass @ u))) if len(u) else 0.0
        return self._sag[1]

    def _springs(self, grabs: Sequence[Grab]) -> Springs:
        U, rest, count = self._space.reduced_basis.fields, self._space.scene.mesh.vertices, len(grabs)
        springs = Springs(np.zeros((count, 3, U.shape[2])), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count))
        for i, grab in enumerate(grabs):
            check_within(grab.vertices, len(rest))
            springs.B[i] = U[grab.vertices].mean(axis=0)
            springs.centre[i] = rest[grab.vertices].mean(axis=0)
        return springs

    def _reference(self) -> StepReference:
        return step_reference(self.model, self.springs, self._minimisation, self.work, self.series)


def _same_gravity(left: Array | None, right: Array | None) -> bool:
    """Whether both are alike; a motion that turns gravity has another array for each frame."""
    return left is right or (left is not None and right is not None and np.array_equal(left, right))


def same_arrays(left: Sequence[Indices], right: Sequence[Indices]) -> bool:
    """Whether both hold the same arrays, which a drag keeps from frame to frame."""
    return left is right or (len(left) == len(right) and all(map(is_, left, right)))
