"""The rivals step the same solid: their states agree with those of the package to the tolerance."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import cross
from reproduction.rivals.every_element import EveryElement
from reproduction.rivals.full_space_rivals import RestStepper
from reproduction.rivals.scikit_fem_step import ScikitFemStepper
from tests.helpers import reduced_space, scene

TOLERANCE = 1e-8


@pytest.fixture(scope="module")
def solid() -> Scene:
    return scene(cross(resolution=1))


def pull(solid: Scene) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The vertices farthest from the pins, and where they are pulled to."""
    x = solid.mesh.vertices
    end = np.flatnonzero(x[:, 0] > x[:, 0].max() - 1e-9)
    return end, x[end].mean(axis=0) + 0.1 * solid.mesh.diagonal * np.array([0.0, 1.0, 0.5])


@pytest.mark.parametrize("rival", [RestStepper, ScikitFemStepper])
def test_a_rival_of_the_full_space_takes_its_steps(
    rival: type[RestStepper] | type[ScikitFemStepper], solid: Scene
) -> None:
    vertices, target = pull(solid)
    loads = Loads((Grab(vertices, target, 20.0),))
    ours, theirs = FullStepper(solid, FullOptions(tolerance=TOLERANCE)), rival(solid, TOLERANCE)
    state = ours.rest()
    for _ in range(6):
        before = state
        state, _ = ours.step(before, loads)
        other, solution = theirs.step(before, loads)
        assert solution.converged
        moved = np.abs(state.u - before.u).max()
        assert moved > 1e-4 * solid.mesh.diagonal
        np.testing.assert_allclose(other.u, state.u, atol=1e-4 * moved)


def test_every_element_steps_as_all_points_of_a_rule_do(solid: Scene) -> None:
    vertices, target = pull(solid)
    fields = np.random.default_rng(0).normal(size=(solid.mesh.n_vertices, 3, 6))
    fields[solid.pinned] = 0.0
    space = reduced_space(solid, np.linalg.qr(fields.reshape(-1, 6))[0])
    at_rest = solid.mesh.vertices[vertices].mean(axis=0)
    motion = Motion("pull", 12, (Drag(2, at_rest, np.tile(target, (8, 1)), 1e-6, 20.0, True),))
    ours = simulate(ReducedStepper(space, ReducedOptions(tolerance=TOLERANCE)), motion)
    q = np.array([frame.state.q for frame in ours])
    theirs = np.array([frame.state.q for frame in simulate(EveryElement(space), motion)])
    assert len(theirs) == motion.frames
    np.testing.assert_allclose(theirs, q, atol=1e-3 * np.abs(q).max())
