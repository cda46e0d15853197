"""The steps of the C library are those of Python: in every kind of space, material, decoder, with all that may act."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.runtime.library import Library, NativeModel, NativeSolid
from ldsim.runtime.model_file import model_bytes
from ldsim.space.space import Space
from reproduction.bench.follower import Follower
from tests.runtime.problems import SPACES, loads

FRAMES = 1000
# Of a linear solid what one iteration leaves is rounding, on some processors 1e-8.
TIGHT = ReducedOptions(tolerance=4e-8)


def both(library: Library, space: Space, options: ReducedOptions) -> tuple[Array, Array, Array]:
    """Displacements by Python and by C, (N, n, 3), and the iterations of both, (N, 2)."""
    stepper = ReducedStepper(space, options)
    follower = Follower(NativeSolid(NativeModel(library, model_bytes(space, options))), space)
    state: ReducedState = stepper.rest()
    expected, found, iterations = [], [], []
    for acting in loads(space, FRAMES):
        state, solution = stepper.step(state, acting)
        assert solution.converged
        iterations.append((solution.iterations, follower.step(acting)))
        expected.append(stepper.displacement(state))
        found.append(follower.solid.displacements())
    return np.array(expected), np.array(found), np.array(iterations)


@pytest.mark.parametrize("name", SPACES)
def test_a_thousand_frames_with_grabs_agree(library: Library, name: str) -> None:
    space = SPACES[name]()
    expected, found, iterations = both(library, space, TIGHT)
    size = np.abs(expected).max()
    assert size > 0.02 * space.scene.mesh.diagonal
    assert np.abs(found - expected).max() <= 1e-9 * size
    # at this tolerance the gradient is rounding, so that now and then one iteration more is made, or one less
    assert abs(iterations - iterations[:, :1]).max() <= 2
    assert abs(iterations.sum(axis=0) @ [1, -1]) <= 0.05 * iterations[:, 0].sum()


@pytest.mark.parametrize(
    "name", ["latent neo_hookean", "linear neo_hookean", "condensed neo_hookean", "condensed, modes that swing"]
)
def test_at_the_usual_tolerance_every_step_makes_the_same_iterations(library: Library, name: str) -> None:
    expected, found, iterations = both(library, SPACES[name](), ReducedOptions())
    np.testing.assert_array_equal(iterations[:, 1], iterations[:, 0])
    # where a step stops early, what rounding does to the inverse Hessian shows: some ten thousand times itself
    assert np.abs(found - expected).max() <= 1e-7 * np.abs(expected).max()


def test_a_basis_in_single_precision_steps_the_same_and_draws_to_seven_digits(library: Library) -> None:
    space = SPACES["latent neo_hookean"]()
    models = [NativeModel(library, model_bytes(space, single=single)) for single in (False, True)]
    solids = [NativeSolid(model) for model in models]
    for _ in range(50):
        for solid in solids:
            solid.step()
    np.testing.assert_array_equal(solids[0].z, solids[1].z)
    u, v = (solid.displacements() for solid in solids)
    assert 0 < np.abs(u - v).max() < 1e-6 * np.abs(u).max()
