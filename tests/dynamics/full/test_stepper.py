"""Full-space stepping: closed forms of implicit Euler, beams, energy, interruption."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.potential import IncrementalPotential
from ldsim.dynamics.full.stepper import FullState, FullStepper, none_lost
from ldsim.dynamics.simulate import simulate
from ldsim.errors import MotionError, SolverError
from ldsim.mechanics.elastic import elastic_energy
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import beam
from ldsim.optimise.solution import Reason
from tests.helpers import bent, derivative_order, order, scene
from tests.space.test_relaxation import rest_matrices

Array = NDArray[np.float64]
STILL = (0.0, 0.0, 0.0)


def tip(body: Scene) -> NDArray[np.int64]:
    """The vertices farthest from the pinned end."""
    x = body.mesh.vertices[:, 0]
    return np.flatnonzero(x > x.max() - 1e-9)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_the_incremental_potential_has_the_gradient_it_says(material: str, cell_type: str) -> None:
    # every term of the same size, so that none hides behind another
    mesh = beam(0.4, 0.1, 0.1, 2, cell_type)
    body = scene(mesh, material, 10.0, density=0.1, gravity=(0.0, -5e3, 1e3), time_step=0.05)
    rng = np.random.default_rng(0)
    predictor, d = 0.1 * rng.normal(size=body.mesh.vertices.shape), rng.normal(size=body.mesh.vertices.shape)
    d[body.pinned] = 0
    grabs = [Grab(tip(body)[:3], np.array([0.1, 0.3, -0.2]), 5.0), Grab(tip(body)[2:4], np.zeros(3), 2.0)]
    potential = IncrementalPotential(body, predictor, grabs)

    def slope(x: Array) -> float:
        g = np.full(x.size, np.nan)
        potential.value_gradient(x, g)
        assert not g.reshape(-1, 3)[body.pinned].any()
        return float(g @ d.ravel())

    value = lambda x: potential.value_gradient(x, np.empty(x.size))  # noqa: E731
    assert derivative_order(value, slope, bent(body.mesh).ravel(), d.ravel(), 0.05) == pytest.approx(2, abs=0.1)


def test_a_body_too_soft_to_matter_falls_freely_far_from_its_pins() -> None:
    body = scene(beam(2.0, 0.1, 0.1, 1), "linear", youngs_modulus=1e-8, gravity=(0.0, -9.81, 2.0))
    stepper = FullStepper(body, FullOptions(tolerance=1e-12))
    state = stepper.rest()
    for n in range(1, 6):
        state, solution = stepper.step(state, Loads())
        assert solution.converged
        fallen = np.array([0.0, -9.81, 2.0]) * body.time_step**2 * n * (n + 1) / 2
        np.testing.assert_allclose(state.u[tip(body)], np.tile(fallen, (4, 1)), atol=1e-8 * np.abs(fallen).max())


@pytest.mark.parametrize("mode", [0, 1, 4])
def test_an_eigenmode_decays_by_the_recursion_of_implicit_euler(mode: int) -> None:
    body = scene(beam(0.4, 0.1, 0.1, 1), "linear", gravity=STILL, time_step=0.03)
    K, M, _ = rest_matrices(body)
    squares, modes = eigh(K, M)
    shape = np.zeros_like(body.mesh.vertices)
    shape[body.free] = modes[:, mode].reshape(-1, 3)
    damping = 1 + body.time_step**2 * squares[mode]
    assert damping > 1.05
    q, q_before = 1e-2, 1e-2
    stepper = FullStepper(body, FullOptions(tolerance=1e-11))
    state = replace(stepper.rest(), u=q * shape, u_previous=q_before * shape)
    for _ in range(8):
        state, _ = stepper.step(state, Loads())
        q, q_before = (2 * q - q_before) / damping, q
        np.testing.assert_allclose(state.u, q * shape, atol=1e-7 * 1e-2 * np.abs(shape).max())


def hanging_tip(resolution: int) -> float:
    """The tip's static deflection of a cantilever, metres: one step of a time so long that inertia is nothing."""
    mesh = beam(1.0, 0.1, 0.1, resolution, "hex8")
    body = scene(mesh, "linear", youngs_modulus=1e6, poisson_ratio=0.0, time_step=1e6)
    stepper = FullStepper(body, FullOptions(tolerance=1e-9))
    state, solution = stepper.step(stepper.rest(), Loads())
    assert solution.converged
    return float(state.u[tip(body), 1].mean())


def test_a_cantilever_hangs_as_timoshenko_says_with_an_error_that_falls_with_the_square_of_the_cell() -> None:
    # w = q L⁴ / 8 E I + q L² / 2 κ G A with κ = 5/6 (10 (1 + ν)/(12 + 11 ν) at ν = 0, Cowper 1966), G = E/2.
    side, length, E = 0.1, 1.0, 1e6
    load = -1000 * 9.81 * side**2
    bending = load * length**4 / (8 * E * side**4 / 12)
    shear = load * length**2 / (2 * 5 / 6 * E / 2 * side**2)
    resolutions = np.array([1, 2, 4])
    errors = [abs(hanging_tip(r) / (bending + shear) - 1) for r in resolutions]
    assert order(errors, 1 / resolutions) == pytest.approx(2, abs=0.3)
    assert errors[-1] < 0.05


def test_without_forcing_the_energy_never_grows_and_the_solid_comes_to_rest() -> None:
    body = scene(beam(0.4, 0.1, 0.1, 2), "neo_hookean", gravity=STILL)
    start = bent(body.mesh, noise=0.0)
    start[body.pinned] = 0
    start *= np.minimum(body.mesh.vertices[:, :1] / 0.4, 1)
    stepper = FullStepper(body, FullOptions(tolerance=1e-8))
    state = replace(stepper.rest(), u=start, u_previous=start)
    energies = [elastic_energy(body.elements, start)]
    for _ in range(40):
        state, solution = stepper.step(state, Loads())
        assert solution.converged
        velocity = (state.u - state.u_previous) / body.time_step
        energies.append(elastic_energy(body.elements, state.u) + 0.5 * np.vdot(velocity, body.mass @ velocity))
    assert max(np.diff(energies)) <= 0
    assert energies[-1] < 0.05 * energies[0]


def test_pinned_vertices_do_not_move_and_the_given_state_is_left_alone() -> None:
    body = scene(beam(0.4, 0.1, 0.1, 2, "hex8"))
    stepper = FullStepper(body)
    start = stepper.rest()
    state, _ = stepper.step(start, Loads())
    assert not state.u[body.pinned].any()
    assert state.u[body.free].any()
    assert not start.u.any()


def pulled() -> tuple[Scene, Motion]:
    body = scene(beam(0.4, 0.1, 0.1, 2), "neo_hookean", youngs_modulus=2e4)
    targets = np.array([0.4, 0.0, 0.0]) + np.linspace(0, 1, 12)[:, None] * [-0.15, 0.3, 0.1]
    return body, Motion("pull", 16, (Drag(2, np.array([0.4, 0.0, 0.0]), targets, 0.06, 500.0),))


def test_a_run_interrupted_and_resumed_repeats_the_undisturbed_one_bit_for_bit() -> None:
    body, motion = pulled()
    stepper = FullStepper(body, FullOptions(factor_cost=3))
    frames = list(simulate(stepper, motion))
    states, settled = [frame.state for frame in frames], frames[-1].held
    assert stepper.factorisations > 2, "the resumed run must cross a factorisation, or this shows little"
    for frame in (1, 5, 11):
        saved = states[frame]
        copy = FullState(
            saved.u.copy(), saved.u_previous.copy(), saved.u_factor.copy(), saved.fresh_iterations, saved.excess
        )
        held = {i: vertices.copy() for i, vertices in settled.items() if motion.drags[i].start <= frame}
        again = FullStepper(body, FullOptions(factor_cost=3))
        for later in simulate(again, motion, copy, range(frame + 1, 16), held):
            expected = states[later.number]
            np.testing.assert_array_equal(later.state.u, expected.u)
            assert (later.state.fresh_iterations, later.state.excess) == (expected.fresh_iterations, expected.excess)


def test_the_result_of_a_step_does_not_depend_on_where_the_factor_was_made() -> None:
    body, motion = pulled()
    ends = []
    for factor_cost in (1, 1000):
        stepper = FullStepper(body, FullOptions(tolerance=1e-9, factor_cost=factor_cost))
        *_, last = simulate(stepper, motion, frames=range(10))
        ends.append(last.state.u)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-7)


def test_a_strong_grab_takes_the_held_centroid_to_its_target() -> None:
    body, _ = pulled()
    held, target = tip(body), np.array([0.35, 0.1, 0.0])
    stepper = FullStepper(body)
    state = stepper.rest()
    for _ in range(30):
        state, _ = stepper.step(state, Loads((Grab(held, target, 1e6),)))
    np.testing.assert_allclose((body.mesh.vertices + state.u)[held].mean(axis=0), target, atol=1e-4)


def test_a_grab_that_hits_no_vertex_stops_the_run_and_says_so() -> None:
    body, motion = pulled()
    lost = Motion("lost", 5, (replace(motion.drags[0], point=np.array([40.0, 0.0, 0.0])),))
    with pytest.raises(MotionError, match="the grab at frame 2 hits no vertex"):
        list(simulate(FullStepper(body), lost))


def test_a_run_from_an_inverted_state_is_refused_and_names_the_frame() -> None:
    body, motion = pulled()
    inverted = -2.0 * body.mesh.vertices * [1, 0, 0]
    state = FullState(inverted, inverted, np.zeros_like(inverted))
    stepper = FullStepper(body)
    with pytest.raises(
        SolverError, match=r"frame 0: the starting point has infinite energy; cell \d+, at rest .* \(det F = -1\)"
    ):
        list(none_lost(stepper, simulate(stepper, motion, state, range(3))))


@pytest.mark.parametrize("scale", [1.0, 5e-3])
def test_similar_solids_move_alike_however_small_they_are(scale: float) -> None:
    """Lengths and moduli times s, time steps times √s: nothing else changes, but forces are s³ times as large."""
    body = scene(
        beam(0.4 * scale, 0.1 * scale, 0.1 * scale), youngs_modulus=3e4 * scale, time_step=0.01 * np.sqrt(scale)
    )

    def sag(options: FullOptions) -> Array:
        stepper = FullStepper(body, options)
        state = stepper.rest()
        for _ in range(5):
            state, solution = stepper.step(state, Loads())
            assert solution.converged
        return state.u / scale

    exact = sag(FullOptions(tolerance=1e-9 * scale**3))
    np.testing.assert_allclose(sag(FullOptions()), exact, atol=2e-3 * np.abs(exact).max())


def test_what_is_stiffened_twice_is_stiffened_once() -> None:
    body = scene(beam())
    np.testing.assert_array_equal(FullStepper(body).stiffened(2.0).stiffened(3.0).scene.mu, 3.0 * body.mu)


def test_a_solid_that_its_pins_carry_away_is_where_it_should_be_and_one_that_leaves_them_is_not() -> None:
    body = scene(beam(0.4, 0.1, 0.1, 1))
    stepper, carried = FullStepper(body), np.full_like(body.mesh.vertices, 100 * body.mesh.diagonal)
    assert stepper.within(FullState.moving(carried, carried), body.mesh.diagonal)
    left = np.where(body.pinned[:, None], 0.0, carried)
    assert not stepper.within(FullState.moving(left, left), body.mesh.diagonal)


def test_a_run_that_is_lost_without_an_inverted_cell_says_how_far_the_solid_has_left_its_pins() -> None:
    body = scene(beam(0.4, 0.1, 0.1, 1), "linear", youngs_modulus=1e-8, gravity=STILL)
    stepper, left = FullStepper(body), body.mesh.vertices * [1e3, 0, 0]
    with pytest.raises(SolverError, match="^frame 0: .*; the solid has left its pins by 400 m; use weaker loads"):
        list(none_lost(stepper, simulate(stepper, Motion("away", 1), FullState.moving(left, left))))


def test_after_a_factorisation_in_the_middle_of_a_step_the_next_step_tells_what_a_fresh_one_needs() -> None:
    body, motion = pulled()
    frames = list(simulate(FullStepper(body, FullOptions(factor_cost=10)), motion))
    iterations = [frame.solution.iterations for frame in frames]
    midway = [i for i in range(len(frames)) if iterations[i] > 10]
    assert midway and all((frames[i].state.fresh_iterations, frames[i].state.excess) == (-1, 0) for i in midway)
    after = [i + 1 for i in midway if iterations[i + 1] <= 10]
    assert after and all(frames[i].state.fresh_iterations == iterations[i] for i in after)


# Size, Young's modulus and density of beams: of a millimetre, soft, of a hundred metres, and of steel.
SOLIDS = [
    (2.5e-3, 2.5e2, 1e3),
    (1.0, 1e5, 1e3),
    (250.0, 2.5e7, 1e3),
    (0.1, 2e11, 7.8e3),
    (1.0, 2e11, 7.8e3),
    (100.0, 2e11, 7.8e3),
]


@pytest.mark.parametrize(("size", "modulus", "density"), SOLIDS)
def test_a_step_ends_where_rounding_hides_the_rest_of_the_gradient(size: float, modulus: float, density: float) -> None:
    coarse = beam(resolution=1)
    mesh = Mesh(size * coarse.vertices, coarse.cells, coarse.cell_type)
    body = scene(mesh, youngs_modulus=modulus, density=density, time_step=0.01 * math.sqrt(size))
    tip = np.flatnonzero(mesh.vertices[:, 0] > mesh.vertices[:, 0].max() - 1e-9 * size)
    for tolerance in (1e-30, None):
        stepper = FullStepper(body, FullOptions(tolerance=tolerance))
        state = stepper.rest()
        for frame in range(-6, 4):  # first almost at rest, where the energy is all rounding
            to = mesh.vertices[tip].mean(axis=0) + [0.0, 0.02 * size * max(frame, 0), 0.0]
            grabs = (Grab(tip, to, 1e-4 * modulus * size),) if frame >= 0 else ()
            state, solution = stepper.step(state, Loads(grabs))
            assert solution.reason == Reason.CONVERGED
