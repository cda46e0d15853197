"""The simulator: against the full space and other scenes, branched, mistreated, and soaked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.errors import MotionError, SceneError, SolverError
from ldsim.mechanics.grabs import Grab
from ldsim.simulator import Outcome, Simulator, full_simulator
from ldsim.space.basis import inner_product
from ldsim.space.decoder import Decoder
from ldsim.space.pca import orthonormalised
from reproduction.bench.soak import soak
from tests.helpers import reduced_space, unit_basis
from tests.simulator.playable import curved_decoder, modes, solid
from tests.simulator.reluctant import ENDINGS, Reluctant
from tests.simulator.simulators import BODY, TIP, UP, every_kind, kinds, reduced
from tests.space.test_modes import condensed


def test_a_grab_in_a_complete_linear_space_does_what_it_does_in_the_full_space() -> None:
    U = unit_basis(BODY)
    linear, full = reduced(U=U, decoder=Decoder.identity(U.shape[1])), full_simulator(BODY, 1e-9)
    for simulator in (linear, full):
        first = simulator.grab(TIP, TIP + UP, stiffness=40, radius=0.03)
        simulator.grab(TIP - [0.1, 0, 0], TIP - [0.1, 0.03, 0], stiffness=20)
        simulator.step(3)
        first.move(TIP - UP)
        simulator.step(3)
        first.release()
        assert simulator.step(2).outcome == Outcome.SOLVED
    np.testing.assert_allclose(linear.displacement(), full.displacement(), atol=1e-7)
    assert np.abs(full.displacement()).max() > 5e-3


@kinds
def test_gravity_that_is_set_is_the_gravity_of_another_scene(kind: int) -> None:
    gravity = np.array([3.0, -1.0, 20.0])
    other, changed = every_kind(replace(BODY, gravity=gravity))[kind], every_kind()[kind]
    changed.gravity = gravity
    other.step(4)
    changed.step(4)
    np.testing.assert_allclose(changed.displacement(), other.displacement(), atol=1e-8)
    assert np.abs(every_kind()[kind].displacement() - other.displacement()).max() > 1e-3


@kinds
def test_a_material_scale_that_is_set_is_the_material_of_another_scene(kind: int) -> None:
    other, changed = every_kind(replace(BODY, mu=0.2 * BODY.mu, lam=0.2 * BODY.lam))[kind], every_kind()[kind]
    changed.step()
    changed.reset()
    changed.material_scale = 0.2
    other.step(8)
    changed.step(8)
    np.testing.assert_allclose(changed.displacement(), other.displacement(), atol=1e-8)
    changed.material_scale = 1.0
    changed.reset()
    changed.step(8)
    assert np.abs(changed.displacement() - other.displacement()).max() > 1e-4


@kinds
def test_a_restored_state_continues_as_it_did(kind: int) -> None:
    simulator = every_kind()[kind]
    handle = simulator.grab(TIP, TIP + UP, stiffness=40)
    simulator.step(3)
    saved = simulator.save()
    simulator.step(4)
    expected = simulator.displacement()
    handle.release()
    simulator.gravity = (0, 0, 0)
    simulator.material_scale = 5.0
    simulator.step(3)
    for _ in range(2):
        simulator.restore(saved)
        simulator.step(4)
        np.testing.assert_allclose(simulator.displacement(), expected, atol=1e-10)


def test_a_grab_after_restoring_what_another_simulator_saved_leaves_its_grabs_alone() -> None:
    first, second = reduced(), reduced()
    pulls = [first.grab(TIP, TIP + UP, stiffness=k) for k in (40.0, 20.0)]
    second.restore(first.save())
    own = second.grab(TIP, TIP - UP, stiffness=10.0)
    assert [grab.stiffness for grab in second.grabs] == [40.0, 20.0, 10.0]
    own.release()
    assert [pull.on(second).grab.stiffness for pull in pulls] == [40.0, 20.0]


def test_a_state_is_judged_by_the_material_that_it_was_saved_with(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weight moves a condensed solid the farther the softer it is, beside its coordinates."""
    simulator = reduced()
    simulator.step(2)
    saved, shape = simulator.save(), simulator.displacement()
    simulator.material_scale = 0.1
    monkeypatch.setattr(simulator._stepper, "within", lambda state, limit: False)
    simulator.restore(saved)
    np.testing.assert_array_equal(simulator.displacement(), shape)
    assert simulator.material_scale == 1.0


def test_what_is_restored_must_be_of_this_space_and_sane() -> None:
    latent, linear, full = every_kind()
    with pytest.raises(SolverError, match="of another space than reduced"):
        latent.restore(full.save())
    with pytest.raises(SolverError, match="has coordinates"):
        latent.restore(reduced(U=modes(BODY, 6), decoder=curved_decoder(6)).save())
    for bad in (np.nan, 1e6):
        sane = linear.save().state
        assert isinstance(sane, ReducedState)
        state = ReducedState.moving(sane.z, sane.z_previous, np.full(9, bad), sane.q_previous)
        with pytest.raises(SolverError, match="not finite or more than"):
            linear.restore(replace(linear.save(), state=state))


def test_a_step_out_of_bounds_is_not_taken_and_told() -> None:
    simulator = reduced(bound=1e-3)
    simulator.step(30)
    assert simulator.last is not None and simulator.last.outcome == Outcome.HELD
    assert "restore or reset" in simulator.last.message
    assert simulator.counts[Outcome.HELD] > 0
    held = simulator.displacement()
    simulator.step()
    np.testing.assert_array_equal(simulator.displacement(), held)
    simulator.gravity = (0, 0, 0)
    assert simulator.step().outcome == Outcome.SOLVED
    simulator.reset()
    assert not simulator.displacement().any() and simulator.last is None and simulator.counts[Outcome.HELD] == 0


@pytest.mark.parametrize("name", ENDINGS)
def test_a_step_that_fails_is_tried_again_and_told_as_the_try_that_was_taken(name: str) -> None:
    space, ending = reduced_space(BODY, modes(BODY), curved_decoder()), ENDINGS[name]
    stepper = Reluctant(ReducedStepper(space, ReducedOptions(tolerance=1e-9, max_iterations=500)), ending.tries)
    simulator = Simulator(space, stepper)
    record = simulator.step()
    assert (record.outcome, record.reason) == (ending.outcome, ending.reason)
    assert record.gradient_norm == ending.taken
    assert (record.message == "") == (ending.outcome == Outcome.SOLVED)
    assert record.iterations == sum(solution.iterations for _, solution in stepper.made)
    assert record.evaluations == sum(solution.evaluations for _, solution in stepper.made)
    if ending.outcome != Outcome.HELD:
        taken = stepper.made[ending.taken][0]
        np.testing.assert_array_equal(simulator.coordinates, stepper.coordinates(taken))
    assert np.isfinite(simulator.displacement()).all()
    assert simulator.step().outcome == Outcome.SOLVED


def test_grabs_far_outside_everything_leave_the_state_finite_and_bounded() -> None:
    simulator = reduced()
    assert soak(simulator, np.random.default_rng(5), 2000) > 0.1
    assert sum(simulator.counts.values()) == 2000
    simulator.reset()
    assert simulator.step().outcome == Outcome.SOLVED


def test_a_grab_holds_the_same_vertices_from_rest_in_every_space_and_state() -> None:
    held = []
    for simulator in every_kind():
        simulator.step(5)
        held.append(simulator.grab(TIP, TIP + UP, at_rest=True).vertices)
    for vertices in held:
        np.testing.assert_array_equal(vertices, held[0])


def test_bad_values_are_refused_in_words() -> None:
    simulator = reduced()
    for point, target, words in (
        ((9, 9, 9), TIP, "hits no vertex"),
        (BODY.mesh.vertices[0], (np.nan, 0, 0), "three finite numbers in m"),
        ((1, 2), TIP, "three finite numbers in m"),
    ):
        with pytest.raises(MotionError, match=words):
            simulator.grab(point, target)
    with pytest.raises(MotionError, match="only pinned vertices"):
        simulator.grab(BODY.mesh.vertices[BODY.pinned][0], TIP, radius=0.0)
    with pytest.raises(MotionError, match="stiffness must be positive"):
        simulator.grab(TIP, TIP, stiffness=-1.0)
    with pytest.raises(SceneError, match="material scale is 0"):
        simulator.material_scale = 0.0
    with pytest.raises(MotionError, match="gravity"):
        simulator.gravity = (0, np.inf, 0)
    with pytest.raises(ValueError, match="at least 1"):
        simulator.step(0)


@kinds
def test_a_handle_tells_where_what_it_holds_is(kind: int) -> None:
    simulator = every_kind()[kind]
    handle = simulator.grab(TIP, TIP + UP, radius=0.06)
    simulator.step(5)
    moved = BODY.mesh.vertices + simulator.displacement()
    np.testing.assert_allclose(handle.centroid, moved[handle.vertices].mean(axis=0), atol=1e-14)


def test_a_handle_that_was_released_says_so() -> None:
    simulator = reduced()
    handle = simulator.grab(TIP, TIP + UP)
    handle.release()
    handle.release()
    with pytest.raises(MotionError, match="was released"):
        handle.move(TIP)
    other = simulator.grab(TIP, TIP + UP)
    simulator.reset()
    with pytest.raises(MotionError, match="was released"):
        other.move(TIP)


def test_the_full_stepper_tells_how_far_the_solid_is_from_where_its_pins_have_come_to() -> None:
    """Sheared and carried far away: of s x the root mean square over 0 ≤ x ≤ L is s L/√3."""
    stepper, x = FullStepper(BODY), BODY.mesh.vertices[:, 0] - BODY.mesh.vertices[:, 0].min()
    state = replace(stepper.rest(), u=np.outer(x, [0.0, 0.3, 0.4]) + [7.0, -5.0, 3.0])
    far = 0.5 * x.max() / np.sqrt(3)
    assert stepper.within(state, far * (1 + 1e-9)) and not stepper.within(state, far * (1 - 1e-9))
    assert not stepper.within(replace(state, u=state.u * np.nan), np.inf)


def test_a_grab_at_a_pinned_point_warns_and_one_beside_it_does_not() -> None:
    simulator = full_simulator(BODY)
    pinned = BODY.mesh.vertices[BODY.pinned][0]
    with pytest.warns(UserWarning, match="is pinned and will not move"):
        simulator.grab(pinned, pinned + UP, radius=0.2)
    simulator.grab(TIP, TIP + UP)


def test_a_name_that_is_none_of_its_own_is_refused() -> None:
    with pytest.raises(AttributeError):
        full_simulator(BODY).gravityy = (0, 0, 0)  # type: ignore[attr-defined]


def test_it_says_in_a_line_what_it_is() -> None:
    simulator = reduced()
    simulator.grab(TIP, TIP + UP)
    simulator.step(2)
    assert repr(simulator) == (
        f"<Simulator: {simulator.space.name} space of {simulator.space.decoder.r} numbers, "
        f"{BODY.mesh.n_vertices:,} vertices, at {2 * BODY.time_step:.4g} s with 1 grab>"
    )


def test_following_takes_over_shape_velocity_and_grabs() -> None:
    """A complete linear space and the full one go on alike, whichever follows."""
    U = orthonormalised(unit_basis(BODY), inner_product(BODY.mass, "mass")).matrix
    simulators = [full_simulator(BODY, 1e-9), reduced(U=U, decoder=Decoder.identity(U.shape[1]))]
    for first, second in (simulators, simulators[::-1]):
        first.reset()
        pull = first.grab(TIP, TIP + UP)
        first.step(4)
        second.follow(first)
        np.testing.assert_allclose(second.displacement(), first.displacement(), atol=1e-9)
        np.testing.assert_allclose(second.velocity(), first.velocity(), atol=1e-7)
        pull.on(second).move(TIP - UP)
        pull.move(TIP - UP)
        first.step(3)
        second.step(3)
        assert second.time == first.time
        np.testing.assert_allclose(second.displacement(), first.displacement(), atol=1e-7)


def test_in_the_space_of_the_other_following_loses_nothing() -> None:
    """Not what weight and grabs move beside the coordinates either, which no frame tells of a condensed solid."""

    def opened() -> Simulator:
        space = replace(condensed())
        return Simulator(space, ReducedStepper(space))

    for make in (opened, reduced):
        first, second, third = make(), make(), make()
        rest = first.scene.mesh.vertices
        first.grab(rest[-1], rest[-1] + 0.1 * first.scene.mesh.diagonal)
        first.step(4)
        second.follow(first)
        third.material_scale = 2.0
        third.follow(first)
        for steps in (0, 1, 3):
            if steps:
                for simulator in (first, second, third):
                    simulator.step(steps)
            np.testing.assert_array_equal(second.displacement(), first.displacement())
            np.testing.assert_array_equal(second.velocity(), first.velocity())
            off = third.displacement() - first.displacement()  # it makes its preconditioner anew
            assert np.abs(off).max() < 0.01 * np.abs(first.displacement()).max()
        assert np.abs(first.displacement()).max() > 1e-3


@kinds
def test_what_another_solid_does_is_not_followed(kind: int) -> None:
    simulator, other = every_kind()[kind], full_simulator(solid(2))
    simulator.step()
    before = simulator.displacement()
    with pytest.raises(SolverError, match="^a solid of 54 vertices cannot be followed by one of 12$"):
        simulator.follow(other)
    np.testing.assert_array_equal(simulator.displacement(), before)


@kinds
@pytest.mark.parametrize(
    ("grab", "message"),
    [
        (Grab(np.array([3, 12]), TIP, 40.0), "from 3 to 12; they must be from 0 to 11"),
        (Grab(np.array([11, 11]), TIP, 40.0), "a grab has a vertex twice"),
        (11, "a grab is 11; it must be a Grab"),
    ],
)
def test_a_grab_of_ones_own_that_means_nothing_is_refused_and_nothing_is_held(
    kind: int, grab: Grab, message: str
) -> None:
    simulator = every_kind()[kind]
    with pytest.raises(MotionError, match=message):
        simulator.set_grabs([Grab(np.array([10]), TIP, 40.0), grab])
    assert not simulator.held
    assert simulator.step().outcome == Outcome.SOLVED


@kinds
def test_a_grab_of_ones_own_may_be_of_lists_and_smaller_numbers(kind: int) -> None:
    simulator, other = every_kind()[kind], every_kind()[kind]
    simulator.set_grabs([Grab(np.array([10, 11]), TIP + UP, 40.0)])
    other.set_grabs([Grab([10, 11], (TIP + UP).tolist(), 40)])  # type: ignore[arg-type]
    simulator.step(3)
    other.step(3)
    np.testing.assert_array_equal(other.displacement(), simulator.displacement())
    with pytest.raises(MotionError, match="must be one positive number"):
        simulator.grab(TIP, TIP, stiffness=np.array([30.0]))  # type: ignore[arg-type]
