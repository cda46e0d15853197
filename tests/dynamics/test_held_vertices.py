"""What grabs hold, in every stepper: vertices of its mesh, or a refusal."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ldsim.dynamics.batched import BatchedStepper
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.errors import MotionError
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.scene import Scene
from ldsim.space.space import Space
from tests.dynamics.batched.solids import basis, body, curved
from tests.helpers import reduced_space
from tests.runtime.problems import condensed


def latent() -> Space:
    return reduced_space(body(), basis(body()), curved())


def full_step(scene: Scene, loads: Loads) -> None:
    stepper = FullStepper(scene)
    stepper.step(stepper.rest(), loads)


def reduced_step(space: Space, loads: Loads) -> None:
    stepper = ReducedStepper(space)
    stepper.step(stepper.rest(), loads)


def batched_step(space: Space, loads: Loads) -> None:
    stepper = BatchedStepper(space)
    stepper.step(stepper.rest(), stepper.loads([loads]))


STEPPERS: dict[str, tuple[Callable[[], Scene], Callable[[Loads], None]]] = {
    "full": (body, lambda loads: full_step(body(), loads)),
    "latent": (body, lambda loads: reduced_step(latent(), loads)),
    "latent, batched": (body, lambda loads: batched_step(latent(), loads)),
    "condensed": (lambda: condensed().scene, lambda loads: reduced_step(condensed(), loads)),
    "condensed, batched": (lambda: condensed().scene, lambda loads: batched_step(condensed(), loads)),
}


@pytest.mark.parametrize(("scene", "step"), STEPPERS.values(), ids=STEPPERS)
def test_a_vertex_beyond_the_mesh_is_named(scene: Callable[[], Scene], step: Callable[[Loads], None]) -> None:
    vertices = scene().mesh.vertices
    n = len(vertices)
    step(Loads((Grab(np.array([n - 2, n - 1]), vertices[n - 1], 40.0),)))
    for kind in (np.int64, np.int32):
        words = f"the vertices of a grab are from {n - 1} to {n}; they must be from 0 to {n - 1}"
        with pytest.raises(MotionError, match=words):
            step(Loads((Grab(np.array([n, n - 1], dtype=kind), vertices[n - 1], 40.0),)))
