"""The condensed space of linear elasticity, beside static condensation by hand and the full space."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.materials import material_number
from ldsim.space.basis import Basis
from ldsim.space.relaxation import Relaxation
from reproduction.rivals.condensed_linear import condensed_linear
from tests.space.test_relaxation import beam, modes


@pytest.fixture(scope="module")
def relaxation() -> Relaxation:
    """Each coordinate a mode of its own and, half as much, one that is then slaved to it."""
    body = beam()
    found = modes(body, 12).matrix
    return Relaxation(body, Basis.of((found[:, :6] + 0.5 * found[:, 6:]) / np.sqrt(1.25), body.mass))


def test_its_force_is_the_rest_stiffness_times_its_coordinates(relaxation: Relaxation) -> None:
    space = condensed_linear(relaxation)
    stepper, z = ReducedStepper(space), np.random.default_rng(0).normal(size=6)
    S = relaxation.rest.stiffness
    model, _, _ = stepper.compiled()
    assert model.kind.tolist() == [material_number("linear")] * 6
    # w μ (a·z) a, summed over the sheared points
    shear = model.G[:, 1, :6]
    force = (model.weights * model.mu * (shear @ z)) @ shear
    np.testing.assert_allclose(force, S @ z, rtol=1e-10, atol=1e-12 * np.abs(S @ z).max())


def test_it_decodes_to_the_tangents_at_rest(relaxation: Relaxation) -> None:
    space, z = condensed_linear(relaxation), np.random.default_rng(1).normal(size=6)
    u = space.displacement(space.decoder(z[None])[0])
    np.testing.assert_allclose(u, relaxation.rest.tangents @ z, atol=1e-10 * np.abs(u).max())


def test_of_vibration_modes_nothing_is_slaved() -> None:
    body = beam()
    V = modes(body, 4)
    np.testing.assert_allclose(condensed_linear(Relaxation(body, V)).reduced_basis.matrix, V.matrix, atol=1e-9)


def test_a_small_pull_moves_it_as_it_moves_the_solid(relaxation: Relaxation) -> None:
    scene = relaxation.scene
    tip = np.array([int(scene.mesh.vertices[:, 0].argmax())])
    target = scene.mesh.vertices[tip[0]] + 1e-5 * np.array([0.3, 1.0, 0.2])
    loads = Loads((Grab(tip, target, 100.0),), gravity=np.zeros(3))
    linear, full = ReducedStepper(condensed_linear(relaxation), ReducedOptions(tolerance=1e-14)), FullStepper(scene)
    state, u = linear.rest(), full.rest()
    for _ in range(400):
        state, _ = linear.step(state, loads)
        u, _ = full.step(u, loads)
    moved = linear.displacement(state)
    assert np.abs(moved - u.u).max() < 0.02 * np.abs(u.u).max()
