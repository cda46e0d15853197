"""Springs in series with a compliance that warps: of a solid that is stretched and turned, and the lever of a dent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.dynamics.reduced.in_series import InSeries
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.potential import Springs
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.reduced.warped import warp_springs
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.script import rotations
from ldsim.space.compliance import LEAST_STRETCH, warp
from ldsim.space.encoder import Encoder
from ldsim.space.space import Space
from tests.runtime.problems import condensed, with_linear_dents

TURN = rotations(np.array([1.0, 2.0, 2.0]) / 3, np.array([0.7]))[0]


@pytest.fixture(scope="module")
def space() -> Space:
    return condensed()


def held(space: Space, way: tuple[float, float, float]) -> Loads:
    """A grab of the vertices at the far end, with its target that way from their centroid."""
    x = space.scene.mesh.vertices
    vertices = np.argsort(-x[:, 0])[:4]
    return Loads((Grab(vertices, x[vertices].mean(axis=0) + way, 30.0),))


def pulled_energy(space: Space, q: Array, loads: Loads) -> float:
    """The most over forces f of f·p − |f|²/2k less the complementary energy of the dent, its frame that of q."""
    compliance, grab = space.compliance, loads.grabs[0]
    assert compliance is not None
    u, dent = space.displacement(q), compliance.dent(grab.vertices)
    A = warp((space.scene.mesh.vertices + u).T @ compliance.arms(grab.vertices))
    C = dent.compliance + np.tensordot(q[: space.r], dent.coupling, 1)
    p = grab.target - (space.scene.mesh.vertices + u + compliance.sag(loads.gravity))[grab.vertices].mean(axis=0)
    f = np.zeros(3)
    for _ in range(8):
        own = f @ A
        slope = p - f / grab.stiffness - A @ (C @ own + 0.5 * dent.second @ own @ own)
        f = f + np.linalg.solve(np.eye(3) / grab.stiffness + A @ (C + dent.second @ own) @ A.T, slope)
    own = f @ A
    beside = 0.5 * own @ C @ own + dent.second @ own @ own @ own / 6
    return float(f @ p - 0.5 * f @ f / grab.stiffness - beside)


def warped(space: Space, loads: Loads, q: Array) -> tuple[InSeries, Springs]:
    """The springs of a step that begins at q."""
    series = InSeries.of(space, loads.grabs, loads.gravity)
    series.target[:] = loads.grabs[0].target
    springs = Springs(np.zeros((1, 3, len(q))), np.zeros((1, 3)), np.zeros((1, 3)), np.ones(1))
    model, _, work = ReducedStepper(space).compiled()
    warp_springs(series, model, q, springs, work)
    return series, springs


def test_the_springs_of_a_step_pull_as_their_energy_says_whose_compliance_moves_with_the_solid(space: Space) -> None:
    loads, q = held(space, (0.02, 0.03, -0.01)), np.zeros(space.decoder.k)
    _, springs = warped(space, loads, q)
    pull = -np.einsum("gaf,ga->f", springs.B, springs.target - springs.centre - springs.B @ q)
    h = 1e-6
    slope = [
        (pulled_energy(space, h * e, loads) - pulled_energy(space, -h * e, loads)) / (2 * h) for e in np.eye(len(q))
    ]
    np.testing.assert_allclose(pull, slope, rtol=1e-5, atol=1e-6 * np.abs(slope).max())


def test_what_the_spring_pulls_with_makes_the_dent(space: Space) -> None:
    loads = held(space, (0.02, 0.03, -0.01))
    series, _ = warped(space, loads, np.zeros(space.decoder.k))
    assert space.compliance is not None
    grab = loads.grabs[0]
    force = grab.stiffness * (series.target - series.centre - series.dents)
    np.testing.assert_allclose(series.forces, force, rtol=1e-9)
    moved = space.compliance.moved(grab.vertices, np.zeros_like(space.scene.mesh.vertices), force)
    np.testing.assert_allclose(series.dents, moved[grab.vertices].mean(axis=0), rtol=1e-6)


def test_where_a_step_begins_the_lever_moves_nothing(space: Space) -> None:
    q = 0.01 * np.random.default_rng(1).normal(size=space.decoder.k)
    series, _ = warped(space, held(space, (0.02, 0.03, -0.01)), q)
    assert np.abs(series.levers - series.B).max() > 1e-3 * np.abs(series.B).max()
    there = series.centre + series.B @ q - series.aside
    np.testing.assert_allclose(series.base + series.levers @ q, there, atol=1e-15)


@pytest.mark.parametrize("stretches", [(1.0, 1.0, 1.0), (1.3, 0.9, 0.8), (1.5, 1.2, LEAST_STRETCH / 3)])
def test_what_is_stretched_gives_way_further_and_what_is_turned_turns(stretches: tuple[float, float, float]) -> None:
    _, Q = np.linalg.eigh(TURN + TURN.T)
    F = TURN @ (Q * stretches) @ Q.T
    expected = TURN @ (Q * np.sqrt(np.maximum(stretches, LEAST_STRETCH))) @ Q.T
    np.testing.assert_allclose(warp(F), expected, atol=1e-12)


def test_the_deformation_gradient_at_a_grab_is_that_of_an_affine_map(space: Space) -> None:
    compliance, x = space.compliance, space.scene.mesh.vertices
    assert compliance is not None
    F = TURN @ np.diag([1.2, 0.9, 1.1])
    np.testing.assert_allclose((x @ F.T + [1.0, 2.0, 3.0]).T @ compliance.arms(np.array([5, 8])), F, atol=1e-12)


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("gravity", [None, (0.0, 4.0, -20.0)])
def test_how_far_the_solid_is_is_bounded_by_what_costs_less(
    space: Space, gravity: tuple[float, ...] | None, linear: bool
) -> None:
    """In the states of a motion that takes hold, pulls at two places, and lets go; dents of either law."""
    space = with_linear_dents() if linear else space
    stepper, other = ReducedStepper(space), Grab(np.arange(30, 34), space.scene.mesh.vertices[31] + 0.02, 50.0)
    acting = None if gravity is None else np.array(gravity)
    pull = held(space, (0.05, 0.06, -0.03)).grabs
    state = stepper.rest()
    for grabs in [()] * 3 + [pull] * 5 + [(*pull, other)] * 5 + [(other,)] * 3 + [()] * 3:
        state, _ = stepper.step(state, Loads(grabs, acting))
        exact, bound = stepper._extent(state), stepper._bound(state)
        assert exact <= bound < 3 * exact
        assert stepper.within(state, exact) and not stepper.within(state, 0.999 * exact)
    state = stepper.rest()  # where only the dent of a hard pull is left, and what weight moves
    x = space.scene.mesh.vertices[pull[0].vertices].mean(axis=0)
    state.loads = Loads((replace(pull[0], target=x + 1.0, stiffness=1e4),), acting)
    assert stepper._extent(state) <= stepper._bound(state) < 4 * stepper._extent(state)
    state.q[:] = np.nan
    assert not stepper.within(state, np.inf)


@pytest.mark.parametrize("turns", [True, False])
@pytest.mark.parametrize("modes", [6, 30])
def test_a_spring_far_stiffer_than_the_solid_moves_it_no_farther_than_its_target(modes: int, turns: bool) -> None:
    """What a dent has changed to the next order is of all of C, and of that modes have nearly all."""
    space = condensed(modes=modes, turns=turns)
    stepper, x = ReducedStepper(space), space.scene.mesh.vertices
    vertices = np.argsort(-x[:, 0])[:4]
    way, state = np.array([0.02, 0.08, -0.05]), stepper.rest()
    for frame in range(40):
        target = x[vertices].mean(axis=0) + min(frame / 30, 1.0) * way
        state, solution = stepper.step(state, Loads((Grab(vertices, target, 5000.0),)))
        assert solution.reason.name == "CONVERGED"
        assert np.abs(stepper.displacement(state)).max() < 2 * np.linalg.norm(way)


def test_a_restart_from_an_equilibrium_stays_there(space: Space) -> None:
    """What its weight moves beside the coordinates is in the frame, but is no velocity of theirs."""
    first = Encoder((np.eye(space.decoder.k, space.r),), (np.zeros(space.r),))  # z of a pose, as training has it
    stepper = ReducedStepper(replace(space, encoder=first), ReducedOptions(tolerance=1e-10))
    state = stepper.rest()
    for _ in range(400):
        state, _ = stepper.step(state, Loads())
        state = state.standing()
    u = stepper.displacement(state)
    again, _ = stepper.step(stepper.state(u, u), Loads())
    np.testing.assert_allclose(stepper.displacement(again), u, atol=1e-6 * np.abs(u).max())


def test_what_is_stiffened_twice_is_stiffened_once(space: Space) -> None:
    loads, stepper = held(space, (0.02, 0.03, -0.01)), ReducedStepper(space)
    once, twice = stepper.stiffened(3.0), stepper.stiffened(2.0).stiffened(3.0)
    np.testing.assert_array_equal(*(some.displacement(some.step(some.rest(), loads)[0]) for some in (once, twice)))


def test_gravity_that_turns_moves_the_centres_alone(space: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a grab holds is looked up once; the steps are those of a stepper that looks it up each time."""
    grabs = held(space, (0.02, 0.03, -0.01)).grabs
    turned = [Loads(grabs, np.array([i, -9.0, 3.0 - i])) for i in range(6)]
    stepper, made, of = ReducedStepper(space), list[int](), InSeries.of
    monkeypatch.setattr(InSeries, "of", lambda *given: made.append(1) or of(*given))
    state = other = stepper.rest()
    for loads in turned:
        state, _ = stepper.step(state, loads)
        other, _ = ReducedStepper(space).step(other, loads)
        np.testing.assert_array_equal(state.z, other.z)
    assert len(made) == 1 + len(turned)


def test_two_grabs_pull_with_what_both_dents_leave(space: Space) -> None:
    """A spring is as long as what is left between its target and where the dents of both have brought the solid."""
    x, loads = space.scene.mesh.vertices, held(space, (0.02, 0.03, -0.01))
    second = np.argsort(np.abs(x[:, 0] - x[:, 0].mean()))[:4]
    both = Loads((*loads.grabs, Grab(second, x[second].mean(axis=0) + (0.0, -0.02, 0.02), 40.0)))
    stepper = ReducedStepper(with_linear_dents(), ReducedOptions(tolerance=1e-10))
    state = stepper.rest()
    for _ in range(20):
        state, _ = stepper.step(state, both)
    pulls = stepper.pulls(state)
    series = stepper._workspace().series
    C, A = series.compliance, series.warps
    targets = np.concatenate([grab.target for grab in both.grabs])
    p = (targets - series.centre - series.B @ state.q).reshape(2, 3)
    for i, grab in enumerate(both.grabs):
        dents = sum(A[i] @ C[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] @ A[j].T @ pulls[j] for j in range(2))
        np.testing.assert_allclose(pulls[i], grab.stiffness * (p[i] - dents), rtol=0.02, atol=0.01)
    assert stepper.pulls(stepper.rest()).shape == (0, 3)
