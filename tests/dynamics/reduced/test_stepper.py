"""Reduced stepping: against slow NumPy, against the full space, against itself in other guises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.potential import IncrementalPotential
from ldsim.dynamics.full.preconditioner import grab_rows
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.advance import extrapolate
from ldsim.dynamics.reduced.minimiser import Exchange, exchange_springs
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.potential import value_gradient
from ldsim.dynamics.reduced.state import ReducedState, fields
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.reduced.tangent import add_spring_metric, current_tangent, rest_metric
from ldsim.dynamics.simulate import simulate
from ldsim.errors import MotionError
from ldsim.jit import in_threads
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.motion import Motion, Support
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.mesh.shapes import beam
from ldsim.optimise.solution import Reason
from ldsim.space.basis import inner_product
from ldsim.space.decoder import Decoder, decode, decode_jacobian
from ldsim.space.lifting import Lifting
from ldsim.space.pca import orthonormalised
from tests.helpers import derivative_order, reduced_space, scene

Array = NDArray[np.float64]

MINIMISERS: list[dict[str, object]] = [
    {"method": "lbfgs", "current": False},
    {"method": "lbfgs", "current": False, "inertia": False},
    {"method": "lbfgs"},
    {"method": "bfgs"},
    {"method": "bfgs", "current": False},
    {"method": "newton"},
    {"method": "lbfgs", "current": False, "inertia": False, "every_step": True, "extrapolate": False, "wolfe": True},
]
TET = scene(beam(resolution=1), youngs_modulus=3e4)
HEX = scene(beam(resolution=1, cell_type="hex8"), youngs_modulus=3e4)


def full_basis(body: Scene) -> Array:
    """Every displacement of the free vertices, mass-orthonormal, (3n, 3f)."""
    unit = np.zeros((3 * body.mesh.n_vertices, 3 * len(body.free)))
    rows = (3 * body.free[:, None] + np.arange(3)).ravel()
    unit[rows, np.arange(len(rows))] = 1
    return orthonormalised(unit, inner_product(body.mass, "mass")).matrix


def some_basis(body: Scene, k: int, seed: int = 0) -> Array:
    """The k softest modes' worth of smooth displacements, (3n, k)."""
    x = body.mesh.vertices
    rng = np.random.default_rng(seed)
    s = (x[:, 0] - x[:, 0].min()) / np.ptp(x[:, 0])
    fields = [s[:, None] ** (1 + i % 3) * (rng.normal(size=3) + x @ rng.normal(size=(3, 3)) * 5) for i in range(k)]
    fields = [np.where(body.pinned[:, None], 0.0, field) for field in fields]
    return orthonormalised(np.stack([f.ravel() for f in fields], axis=1), inner_product(body.mass, "mass")).matrix


def curved(k: int, r: int) -> Decoder:
    rng = np.random.default_rng(1)
    weights = [rng.normal(size=(r, 8)), rng.normal(size=(8, k)) * 0.02]
    return Decoder.network(weights, [rng.normal(size=8), np.zeros(k)], "elu", np.eye(r, k))


def stepper(
    body: Scene, U: Array, decoder: Decoder, lifting: Lifting | None = None, **options: object
) -> ReducedStepper:
    wanted = {"tolerance": 1e-8, "max_iterations": 500} | options
    return ReducedStepper(reduced_space(body, U, decoder, lifting=lifting), ReducedOptions(**wanted))  # type: ignore[arg-type]


def full_stepper(body: Scene) -> FullStepper:
    return FullStepper(body, FullOptions(tolerance=1e-9))


def pull(body: Scene, amount: float = 0.05) -> Loads:
    tip = np.argsort(body.mesh.vertices[:, 0])[-4:]
    return Loads((Grab(tip, body.mesh.vertices[tip].mean(axis=0) + [0, amount, amount / 2], 40.0),))


def run(some: ReducedStepper, loads: Loads, frames: int) -> list[ReducedState]:
    states = [some.rest()]
    for _ in range(frames):
        state, solution = some.step(states[-1], loads)
        assert solution.reason == Reason.CONVERGED
        states.append(state)
    return states[1:]


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


def test_a_quasi_static_step_forgets_how_fast_the_solid_was() -> None:
    some = stepper(TET, some_basis(TET, 6), curved(6, 4), tolerance=1e-10, quasistatic=True)
    moving = run(some, pull(TET), 3)[-1]
    ends = [some.step(state, pull(TET, 0.02))[0].q for state in (moving, moving.standing())]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-8)
    assert np.abs(ends[0] - moving.q).max() > 1e-4


def test_a_step_that_does_not_extrapolate_starts_where_the_last_one_ended() -> None:
    """So a solid that is in equilibrium already needs no iteration, whatever its last change was."""
    for goes_on in (False, True):
        some = stepper(TET, some_basis(TET, 6), curved(6, 4), quasistatic=True, extrapolate=goes_on)
        state = some.rest()
        for reach in (0.01, 0.02, 0.03, 0.03):
            state, solution = some.step(state, pull(TET, reach))
        assert (solution.iterations == 0) is not goes_on


def test_the_guess_follows_a_polynomial_and_falls_back_after_a_jolt() -> None:
    some = stepper(TET, some_basis(TET, 6), curved(6, 4))
    t = np.arange(9.0)
    path = np.stack([np.ones(9), t, t**3 - 4 * t**2, 0.1 * t**5], axis=1)
    guesses = [state.guess for state in along(some, path)]
    np.testing.assert_allclose(guesses[-2], path[-1], rtol=1e-9)
    jolted = path.copy()
    jolted[-1] += 1e6
    last = along(some, jolted)[-1]
    np.testing.assert_allclose(last.guess, jolted[-1])  # standing still is the best that is known


def test_springs_of_other_grabs_are_exchanged_in_the_preconditioner() -> None:
    some, rng = stepper(TET, some_basis(TET, 6), curved(6, 4)), np.random.default_rng(5)
    model, _, work = some.compiled()
    decode(model.layers, rng.normal(size=4), work.hidden, work.q)
    decode_jacobian(model.layers, work.hidden, work.tangents, work.jacobian)
    root, none = rng.normal(size=(4, 4)), np.zeros((0, 6))
    rest = root @ root.T + 4 * np.eye(4)
    released, held = rng.normal(size=(3, 6)), rng.normal(size=(6, 6))
    a, b = released @ work.jacobian.T, held @ work.jacobian.T
    H = np.linalg.inv(rest + a.T @ a)
    assert exchange_springs(model, Exchange(False, True, held, released), H, work)
    np.testing.assert_allclose(H, np.linalg.inv(rest + b.T @ b), rtol=1e-9)
    # nearly all curvature was the spring's: what is left is not known by the difference
    H = np.linalg.inv(rest + 1e6 * a.T @ a)
    assert not exchange_springs(model, Exchange(False, True, none, 1e3 * released), H, work)


def along(some: ReducedStepper, path: Array) -> list[ReducedState]:
    """States whose z went along a path, whatever the forces are."""
    states = [some.rest()]
    for z in path:
        data = np.empty(states[-1].room(0))
        new = ReducedState(data, (some.rest().r, some.rest().k))
        before, now = (fields.py_func(state.data, new.r, new.k) for state in (states[-1], new))  # type: ignore[attr-defined]
        now[0][:], now[1][:] = z, before[0]
        extrapolate(before[1], before[0], z, before[6], now[6], now[2])
        states.append(new)
    return states[1:]


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


def shaken(body: Scene, frames: int) -> Motion:
    """All pins carried and turned along a crooked path."""
    rng = np.random.default_rng(5)
    maps = np.eye(3, 4) + np.cumsum(rng.normal(size=(frames, 3, 4)) * [0.02, 0.02, 0.02, 0.003], axis=0)
    return Motion("shaken", frames, supports=(Support(np.flatnonzero(body.pinned), maps),))


def placed(motion: Motion, frame: int) -> tuple[MovedPins, ...]:
    return tuple(MovedPins(support.vertices, support.maps[frame]) for support in motion.supports)


@pytest.mark.parametrize("body", [TET, HEX], ids=["tet4", "hex8"])
def test_pins_that_move_are_followed_as_in_the_full_space(body: Scene) -> None:
    U, motion = full_basis(body), shaken(body, 6)
    lifting = Lifting.of(body, [motion])
    linear = stepper(body, U, Decoder.identity(U.shape[1]), tolerance=1e-9, lifting=lifting)
    full = full_stepper(body)
    state, whole = linear.rest(), full.rest()
    for frame in range(6):
        loads = (pull(body) if frame > 1 else Loads())._replace(pins=placed(motion, frame))
        state, solution = linear.step(state, loads)
        assert solution.reason == Reason.CONVERGED
        whole, _ = full.step(whole, loads)
        np.testing.assert_allclose(linear.displacement(state), whole.u, atol=1e-8)
        np.testing.assert_allclose(linear.space.fields @ linear.coordinates(state), whole.u, atol=1e-8)
    assert np.abs(whole.u[body.pinned]).max() > 0.005


def test_a_latent_space_that_is_linear_follows_moving_pins_as_the_linear_one() -> None:
    U, motion = some_basis(TET, 6), shaken(TET, 6)
    lifting = Lifting.of(TET, [motion])
    flat = Decoder.network([np.zeros((6, 3)), np.zeros((3, 6))], [np.ones(3), np.ones(6)], "elu", np.eye(6))
    ends = []
    for decoder in (Decoder.identity(6), flat):
        some = stepper(TET, U, decoder, tolerance=1e-10, lifting=lifting)
        state = some.rest()
        for frame in range(6):
            state, solution = some.step(state, pull(TET)._replace(pins=placed(motion, frame)))
            assert solution.reason == Reason.CONVERGED
        ends.append(state.q)
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-9)
    assert np.abs(ends[0]).max() > 1e-3


def test_the_tangent_under_moving_pins_is_that_of_a_basis_that_holds_their_displacement() -> None:
    U, motion = some_basis(TET, 6), shaken(TET, 1)
    lifting = Lifting.of(TET, [motion])
    a, q = lifting.coordinates(motion)[0], np.linspace(-0.01, 0.01, 6)
    lifted = stepper(TET, U, Decoder.identity(6), lifting=lifting)
    lifted.step(lifted.rest(), Loads(pins=placed(motion, 0)))
    both = stepper(TET, np.hstack([U, lifting.fields]), Decoder.identity(6 + lifting.count))
    hessians = []
    for some, coordinates in ((lifted, q), (both, np.concatenate([q, a]))):
        model, _, work = some.compiled()
        work.q[:] = coordinates
        current_tangent(model, work)
        hessians.append(work.hessian)
    np.testing.assert_allclose(hessians[0], hessians[1][:6, :6], rtol=1e-9, atol=1e-9)


def test_latent_stepping_with_a_decoder_that_is_linear_is_linear_stepping() -> None:
    U = some_basis(TET, 6)
    nothing = Decoder.network([np.zeros((6, 3)), np.zeros((3, 6))], [np.ones(3), np.ones(6)], "elu", np.eye(6))
    linear = run(stepper(TET, U, Decoder.identity(6)), pull(TET), 8)
    latent = run(stepper(TET, U, nothing), pull(TET), 8)
    for a, b in zip(linear, latent, strict=True):
        np.testing.assert_allclose(b.q, a.q, atol=1e-9)


@pytest.mark.parametrize("options", MINIMISERS, ids=str)
def test_another_basis_of_the_same_space_takes_the_same_steps(options: dict[str, object]) -> None:
    U = some_basis(TET, 6)
    mixed = U @ (np.eye(6) + 0.3 * np.random.default_rng(2).normal(size=(6, 6)))
    diagonal = stepper(TET, U, Decoder.identity(6), tolerance=1e-11, **options)
    dense = stepper(TET, mixed, Decoder.identity(6), tolerance=1e-11, **options)
    for a, b in zip(run(diagonal, pull(TET), 8), run(dense, pull(TET), 8), strict=True):
        np.testing.assert_allclose(dense.displacement(b), diagonal.displacement(a), atol=1e-8)


@pytest.mark.parametrize("options", MINIMISERS, ids=str)
@pytest.mark.parametrize("decoder", [Decoder.identity(6), curved(6, 4)], ids=["linear", "latent"])
def test_every_minimiser_takes_the_same_steps(decoder: Decoder, options: dict[str, object]) -> None:
    U = some_basis(TET, 6)
    reference = run(stepper(TET, U, decoder, tolerance=1e-10), pull(TET), 8)
    others = run(stepper(TET, U, decoder, tolerance=1e-10, **options), pull(TET), 8)
    for a, b in zip(reference, others, strict=True):
        np.testing.assert_allclose(b.q, a.q, atol=1e-8)


@pytest.mark.parametrize("body", [TET, HEX], ids=["tet4", "hex8"])
def test_the_potential_is_that_of_the_full_space_at_the_decoded_state(body: Scene) -> None:
    U, decoder = some_basis(body, 6), curved(6, 4)
    model, springs, work = stepper(body, U, decoder).compiled(pull(body))
    rng = np.random.default_rng(3)
    z, predictor = 0.02 * rng.normal(size=4), 0.02 * rng.normal(size=6)
    full = IncrementalPotential(body, (U @ predictor).reshape(-1, 3), pull(body).grabs)
    force = np.empty(len(U))
    expected = full.value_gradient(U @ decoder(z), force)
    gradient = np.empty(4)
    value = value_gradient(model, springs, predictor, z, work, gradient)
    assert value == pytest.approx(expected, rel=1e-10)
    np.testing.assert_allclose(gradient, decoder.vjp(z, U.T @ force), rtol=1e-9)


def test_the_gradient_is_the_derivative_of_the_potential() -> None:
    U, decoder = some_basis(TET, 6), curved(6, 4)
    model, springs, work = stepper(TET, U, decoder).compiled(pull(TET))
    rng = np.random.default_rng(4)
    z, d, predictor = 0.05 * rng.normal(size=4), 0.05 * rng.normal(size=4), np.zeros(6)
    gradient = np.empty(4)

    def value(x: Array) -> float:
        return value_gradient(model, springs, predictor, x, work, gradient)

    def slope(x: Array) -> float:
        value(x)
        return float(gradient @ d)

    assert derivative_order(value, slope, z, d) > 1.9


@pytest.mark.parametrize("decoder", [Decoder.identity(6), curved(6, 4)], ids=["linear", "latent"])
def test_the_preconditioners_are_the_full_spaces_stiffness_at_rest_and_now_seen_through_the_decoder(
    decoder: Decoder,
) -> None:
    U, some = some_basis(TET, 6), stepper(TET, some_basis(TET, 6), decoder)
    z = 0.3 * np.random.default_rng(5).normal(size=decoder.r)
    J, (model, springs, work) = decoder.jacobian(z), some.compiled(pull(TET))
    work.q[:], work.jacobian[:] = decoder(z), J.T
    u = (U @ work.q).reshape(-1, 3)
    pattern = StiffnessPattern(TET.points.nodes, np.arange(TET.mesh.n_vertices), TET.mesh.n_vertices)
    inertia = some.mass / TET.time_step**2
    for tangent, at in ((rest_metric, 0 * u), (current_tangent, u)):
        K = pattern.matrix(pattern.stiffness_blocks(TET.elements, at, clamp=True))
        expected = J.T @ (inertia + U.T @ (K @ U)) @ J
        tangent(model, work)
        np.testing.assert_allclose(work.hessian, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    before = work.hessian.copy()
    add_spring_metric(springs, model, work)
    rows = grab_rows(pull(TET).grabs, TET.mesh.n_vertices) @ U @ J
    np.testing.assert_allclose(work.hessian - before, rows.T @ rows, rtol=0, atol=1e-9 * np.abs(before).max())


def test_a_step_depends_on_its_state_alone() -> None:
    U, decoder = some_basis(TET, 6), curved(6, 4)
    some = stepper(TET, U, decoder)
    grabs = pull(TET)
    states = run(some, grabs, 5)
    run(some, pull(TET, -0.03), 3)
    again, _ = some.step(states[2], grabs)
    np.testing.assert_array_equal(again.q, states[3].q)


def test_a_step_leaves_its_state_as_it_was() -> None:
    some = stepper(TET, some_basis(TET, 6), curved(6, 4))
    state = run(some, pull(TET), 3)[-1]
    before = state.data.copy()
    after, _ = some.step(state, pull(TET))
    np.testing.assert_array_equal(state.data, before)
    np.testing.assert_array_equal(after.z_previous, state.z)
    np.testing.assert_array_equal(after.q_previous, state.q)


def test_a_state_of_another_model_is_refused() -> None:
    some = stepper(TET, some_basis(TET, 6), curved(6, 4))
    with pytest.raises(ValueError, match=r"has \(r, k\) = \(3, 6\); this stepper has \(4, 6\)"):
        some.step(stepper(TET, some_basis(TET, 6), curved(6, 3)).rest(), Loads())


def test_with_no_gravity_and_no_grab_rest_stays_rest() -> None:
    still = scene(beam(resolution=1), gravity=(0.0, 0.0, 0.0))
    state = run(stepper(still, some_basis(still, 6), curved(6, 4)), Loads(), 3)[-1]
    assert not state.q.any()


def test_energy_never_grows_after_a_release_without_gravity() -> None:
    still = scene(beam(resolution=1), youngs_modulus=3e4, gravity=(0.0, 0.0, 0.0))
    U = some_basis(still, 6)
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


def test_pins_that_a_space_was_not_prepared_for_are_refused() -> None:
    some = stepper(TET, some_basis(TET, 6), Decoder.identity(6))
    with pytest.raises(MotionError, match="pins move; the reduced space has no lifting for them"):
        list(simulate(some, shaken(TET, 2)))


def test_threads_share_a_stepper() -> None:
    some = stepper(TET, some_basis(TET, 6), curved(6, 4))
    amounts = [0.05, -0.03, 0.02, 0.04]
    alone = [run(some, pull(TET, amount), 20)[-1].q for amount in amounts]
    together = in_threads(lambda amount: run(some, pull(TET, amount), 20)[-1].q, amounts, threads=4)
    for expected, found in zip(alone, together, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_stiffened_stepper_is_that_of_a_stiffer_scene() -> None:
    U, decoder = some_basis(TET, 6), curved(6, 4)
    stiffer = replace(TET, mu=2.5 * TET.mu, lam=2.5 * TET.lam)
    found = run(stepper(TET, U, decoder).stiffened(0.5).stiffened(2.5), pull(TET), 6)
    for a, b in zip(run(stepper(stiffer, U, decoder), pull(TET), 6), found, strict=True):
        np.testing.assert_allclose(b.q, a.q, atol=1e-10)
