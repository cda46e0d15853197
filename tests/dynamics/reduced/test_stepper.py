"""Reduced stepping: against the full space, against itself in other guises."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.potential import IncrementalPotential
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.jit import in_threads
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import beam
from ldsim.optimise.solution import Reason
from ldsim.space.decoder import Decoder
from ldsim.space.lifting import Lifting
from tests.dynamics.reduced.solids import HEX, TET, curved, full_basis, full_stepper, placed, pull, run, shaken, stepper
from tests.helpers import scene, smooth_basis


@pytest.mark.parametrize("body", [TET, HEX], ids=["tet4", "hex8"])
def test_linear_stepping_with_a_full_basis_is_full_stepping(body: Scene) -> None:
    U = full_basis(body)
    reduced = run(stepper(body, U, Decoder.identity(U.shape[1]), tolerance=1e-9), pull(body), 6)
    full = full_stepper(body)
    state = full.rest()
    for step in reduced:
        state, _ = full.step(state, pull(body))
        np.testing.assert_allclose((U @ step.q).reshape(-1, 3), state.u, atol=1e-8)


@pytest.mark.parametrize("body", [TET, HEX], ids=["tet4", "hex8"])
def test_quasi_static_steps_with_a_full_basis_are_those_of_the_full_space(body: Scene) -> None:
    U, motion = full_basis(body), shaken(body, 3)
    lifting = Lifting.of(body, [motion])
    linear = stepper(body, U, Decoder.identity(U.shape[1]), tolerance=1e-9, lifting=lifting, quasistatic=True)
    full = FullStepper(body, FullOptions(tolerance=1e-9, quasistatic=True))
    state, whole = linear.rest(), full.rest()
    for frame in range(3):
        loads = pull(body, 0.02 * (1 + frame))._replace(pins=placed(motion, frame))
        state, solution = linear.step(state, loads)
        assert solution.reason == Reason.CONVERGED
        whole, _ = full.step(whole, loads)
        np.testing.assert_allclose(linear.displacement(state), whole.u, atol=1e-8)


def test_gravity_that_changes_is_felt_as_in_the_full_space() -> None:
    load = np.zeros_like(TET.mesh.vertices)
    load[np.argmax(TET.mesh.vertices[:, 0])] = [0.3, 0.2, -0.1]
    body = replace(TET, load=load)
    U = full_basis(body)
    linear = stepper(body, U, Decoder.identity(U.shape[1]), tolerance=1e-9)
    full = full_stepper(body)
    state, whole = linear.rest(), full.rest()
    for gravity in (np.array([3.0, -9.0, 1.0]), np.array([0.0, 12.0, -5.0]), None, np.zeros(3)):
        state, _ = linear.step(state, Loads(gravity=gravity))
        whole, _ = full.step(whole, Loads(gravity=gravity))
        np.testing.assert_allclose(linear.displacement(state), whole.u, atol=1e-8)
    assert np.abs(whole.u).max() > 1e-3


def test_latent_stepping_with_a_decoder_that_is_linear_is_linear_stepping() -> None:
    U = smooth_basis(TET, 6)
    nothing = Decoder.network([np.zeros((6, 3)), np.zeros((3, 6))], [np.ones(3), np.ones(6)], "elu", np.eye(6))
    linear = run(stepper(TET, U, Decoder.identity(6)), pull(TET), 8)
    latent = run(stepper(TET, U, nothing), pull(TET), 8)
    for a, b in zip(linear, latent, strict=True):
        np.testing.assert_allclose(b.q, a.q, atol=1e-9)


def test_a_step_depends_on_its_state_alone() -> None:
    U, decoder = smooth_basis(TET, 6), curved(6, 4)
    some = stepper(TET, U, decoder)
    grabs = pull(TET)
    states = run(some, grabs, 5)
    run(some, pull(TET, -0.03), 3)
    again, _ = some.step(states[2], grabs)
    np.testing.assert_array_equal(again.q, states[3].q)


def test_a_step_leaves_its_state_as_it_was() -> None:
    some = stepper(TET, smooth_basis(TET, 6), curved(6, 4))
    state = run(some, pull(TET), 3)[-1]
    before = state.data.copy()
    after, _ = some.step(state, pull(TET))
    np.testing.assert_array_equal(state.data, before)
    np.testing.assert_array_equal(after.z_previous, state.z)
    np.testing.assert_array_equal(after.q_previous, state.q)


def test_a_state_of_another_model_is_refused() -> None:
    some = stepper(TET, smooth_basis(TET, 6), curved(6, 4))
    with pytest.raises(ValueError, match=r"has \(r, k\) = \(3, 6\); this stepper has \(4, 6\)"):
        some.step(stepper(TET, smooth_basis(TET, 6), curved(6, 3)).rest(), Loads())


def test_with_no_gravity_and_no_grab_rest_stays_rest() -> None:
    still = scene(beam(resolution=1), gravity=(0.0, 0.0, 0.0))
    state = run(stepper(still, smooth_basis(still, 6), curved(6, 4)), Loads(), 3)[-1]
    assert not state.q.any()


def test_energy_never_grows_after_a_release_without_gravity() -> None:
    still = scene(beam(resolution=1), youngs_modulus=3e4, gravity=(0.0, 0.0, 0.0))
    U = smooth_basis(still, 6)
    some = stepper(still, U, curved(6, 4))
    state = run(some, pull(still), 10)[-1]
    energies = []
    for _ in range(40):
        before = state
        state, _ = some.step(before, Loads())
        velocity = (state.q - before.q) / still.time_step
        rest_of_step = IncrementalPotential(still, (U @ state.q).reshape(-1, 3), [])
        energies.append(rest_of_step.value_gradient(U @ state.q, np.empty(len(U))) + 0.5 * velocity @ velocity)
    assert (np.diff(energies) <= 1e-9 * energies[0]).all()
    assert energies[-1] < 0.9 * energies[0]


def test_a_start_of_infinite_energy_is_reported_and_the_state_kept() -> None:
    U = full_basis(TET)
    some = stepper(TET, U, Decoder.identity(U.shape[1]))
    inverted = -2 * TET.mesh.vertices
    inverted[TET.pinned] = 0
    q = U.T @ (TET.mass @ inverted).ravel()
    _, solution = some.step(ReducedState.moving(q, q, q, q), Loads())
    assert solution.reason == Reason.INFINITE_START


def test_threads_share_a_stepper() -> None:
    some = stepper(TET, smooth_basis(TET, 6), curved(6, 4))
    amounts = [0.05, -0.03, 0.02, 0.04]
    alone = [run(some, pull(TET, amount), 20)[-1].q for amount in amounts]
    together = in_threads(lambda amount: run(some, pull(TET, amount), 20)[-1].q, amounts, threads=4)
    for expected, found in zip(alone, together, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_stiffened_stepper_is_that_of_a_stiffer_scene() -> None:
    U, decoder = smooth_basis(TET, 6), curved(6, 4)
    stiffer = replace(TET, mu=2.5 * TET.mu, lam=2.5 * TET.lam)
    found = run(stepper(TET, U, decoder).stiffened(0.5).stiffened(2.5), pull(TET), 6)
    for a, b in zip(run(stepper(stiffer, U, decoder), pull(TET), 6), found, strict=True):
        np.testing.assert_allclose(b.q, a.q, atol=1e-10)


def test_a_solid_of_tons_moves_as_a_light_one() -> None:
    """Density and modulus times as much change nothing in how it moves, but forces grow as much."""

    def sag(times: float) -> NDArray[np.float64]:
        body = scene(beam(resolution=1), youngs_modulus=3e4 * times, density=1000 * times)
        some = stepper(body, smooth_basis(body, 6), Decoder.identity(6), tolerance=None)
        state = some.rest()
        for _ in range(5):
            state, _ = some.step(state, Loads())
        return some.displacement(state)

    light = sag(1.0)
    np.testing.assert_allclose(sag(1e6), light, atol=0.02 * np.abs(light).max())


@pytest.mark.parametrize("decoder", [Decoder.identity(9), curved(9, 4)], ids=["linear", "latent"])
@pytest.mark.parametrize("size", [0.25, 2.5, 250.0])
def test_a_step_of_steel_ends_where_rounding_hides_the_rest_of_the_gradient(size: float, decoder: Decoder) -> None:
    coarse = beam(resolution=1)
    mesh = Mesh(size * coarse.vertices, coarse.cells, coarse.cell_type)
    body = scene(mesh, youngs_modulus=2e11, density=7.8e3, time_step=0.01 * math.sqrt(size))
    tip = np.flatnonzero(mesh.vertices[:, 0] > mesh.vertices[:, 0].max() - 1e-9 * size)
    given = stepper(body, smooth_basis(body, 9), decoder, tolerance=1e-30)
    for some in (given, given.stiffened(4.0)):
        state = some.rest()
        for frame in range(1, 9):
            to = mesh.vertices[tip].mean(axis=0) + [0.0, 0.02 * size * frame, 0.0]
            state, solution = some.step(state, Loads((Grab(tip, to, 6e7 * size),)))
            assert solution.reason == Reason.CONVERGED
            pull = 6e7 * size * 0.02 * size * frame / math.sqrt(body.vertex_mass.sum())
            assert solution.gradient_norm < 1e-8 * pull
