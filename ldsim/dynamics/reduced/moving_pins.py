"""What moving pins do in a reduced step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ldsim.arrays import Array
from ldsim.cubature.rule import strain_maps
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.workspace import Workspace
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.space.lifting import Lifting
from ldsim.space.space import Space


class MovingPins(NamedTuple):
    """What the steps need of moving pins, L.

    Attributes:
        fields: L by vertex, (n, 3, l).
        strain: at the rule's points, (c, 9, l), 1/m.
        inertia: UᵀML/h², (k, l).
        rest: positions of all vertices, (n, 3), metres.
    """

    lifting: Lifting
    fields: Array
    strain: Array
    inertia: Array
    rest: Array

    @classmethod
    def of(cls, space: Space, quasistatic: bool = False) -> MovingPins:
        scene = space.scene
        lifting = Lifting.of(scene, ()) if space.lifting is None else space.lifting
        L = lifting.fields
        momentum = np.asarray(scene.mass @ L.reshape(scene.mesh.n_vertices, -1)).reshape(L.shape)
        inertia = (0.0 if quasistatic else 1.0) * space.reduced_basis.matrix.T @ momentum / scene.time_step**2
        fields = L.reshape(scene.mesh.n_vertices, 3, -1)
        return cls(lifting, fields, strain_maps(scene, L, space.rule.points), inertia, scene.mesh.vertices)

    def coordinates(self, loads: Loads) -> Array:
        """a, (l,)."""
        return self.lifting.at(loads.pins)

    def move(
        self, a: Array | None, state: ReducedState, force: Array, workspace: Workspace, grabs: Sequence[Grab]
    ) -> None:
        """Put the pins where they are in this frame: their strain, their momentum, and the grabs' centroids."""
        assert a is not None
        rest = np.zeros(len(a))
        before = rest if state.a is None else state.a
        earlier = rest if state.a_previous is None else state.a_previous
        workspace.model.force[:] = force - self.inertia @ (a - 2 * before + earlier)
        workspace.model.lifted[:] = self.strain @ a
        for i, grab in enumerate(grabs):
            centre = self.rest[grab.vertices].mean(axis=0)
            workspace.springs.centre[i] = centre + self.fields[grab.vertices].mean(axis=0) @ a
