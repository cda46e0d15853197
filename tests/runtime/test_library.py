"""What a host does with the C library besides stepping: it behaves as the simulator in Python, and refuses in words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.errors import SceneError, SolverError
from ldsim.mechanics.materials import MATERIALS
from ldsim.mesh.shapes import beam
from ldsim.runtime.library import Library, NativeModel, NativeSolid
from ldsim.runtime.model_file import model_bytes
from ldsim.simulator.records import Outcome
from ldsim.simulator.simulator import Simulator
from ldsim.space.space import Space
from tests.helpers import scene
from tests.runtime import problems
from tests.runtime.problems import SPACES, latent, linear, with_linear_dents

OUTCOMES = (Outcome.SOLVED, Outcome.SHORT, Outcome.SLOWED, Outcome.HELD)


def pair(library: Library, space: Space, options: ReducedOptions = ReducedOptions()) -> tuple[Simulator, NativeSolid]:
    simulator = Simulator(space, ReducedStepper(space, options))
    return simulator, NativeSolid(NativeModel(library, model_bytes(space, options)))


def tip(space: Space) -> Any:
    x = space.scene.mesh.vertices
    return x[x[:, 0].argmax()]


@pytest.mark.parametrize("name", ["latent neo_hookean", "linear neo_hookean", "condensed neo_hookean"])
def test_a_solid_is_grabbed_moved_stiffened_and_let_go_as_in_the_simulator(library: Library, name: str) -> None:
    space = SPACES[name]()
    simulator, solid = pair(library, space, ReducedOptions(tolerance=1e-8))
    size, point = space.scene.mesh.diagonal, tip(space)
    handle, grab = simulator.grab(point, point + 0.2 * size, 50.0), solid.grab(point, point + 0.2 * size, 50.0)

    def compare() -> None:
        for _ in range(15):
            simulator.step()
            solid.step()
        np.testing.assert_allclose(solid.displacements(), simulator.displacement(), atol=1e-9 * size)

    compare()
    np.testing.assert_allclose(solid.centroid(grab), handle.centroid, atol=1e-9 * size)
    np.testing.assert_allclose(solid.force(grab), handle.force, atol=1e-8 * np.linalg.norm(handle.force))
    some = np.array([3, 0, 7])
    np.testing.assert_array_equal(solid.displacement(some), solid.displacements()[some])
    handle.move(point - 0.2 * size)
    solid.move(grab, point - 0.2 * size)
    compare()
    # the usual stiffness and radius, where the solid now is
    simulator.grab(point + 0.01 * size, point)
    solid.grab(point + 0.01 * size, point)
    compare()
    simulator.material_scale = 0.3
    solid.set_stiffness(0.3)
    simulator.gravity = gravity = np.array([3.0, 1.0, -4.0])
    solid.set_gravity(gravity)
    compare()
    handle.release()
    solid.release(grab)
    compare()
    if space.novelty is not None:
        assert solid.novelty == pytest.approx(simulator.novelty, rel=1e-6)
    simulator.reset()
    solid.reset()
    compare()


@pytest.mark.parametrize("name", ["latent neo_hookean", "condensed neo_hookean", "condensed, modes that swing"])
@pytest.mark.parametrize("seed", range(3))
def test_in_whatever_order_it_is_told_what_a_solid_is_that_of_the_simulator(
    library: Library, name: str, seed: int
) -> None:
    """After every call: what acted in the last step is seen until the next one, a grab that was let go too."""
    space, rng = SPACES[name](), np.random.default_rng(seed)
    simulator, solid = pair(library, space, ReducedOptions(tolerance=1e-9))
    other = pair(library, space, ReducedOptions(tolerance=1e-9))[1]
    size, X = space.scene.mesh.diagonal, space.scene.mesh.vertices
    held, saved = list[tuple[Any, int]](), list[tuple[Any, bytes, list[tuple[Any, int]]]]()
    for _ in range(60):
        call = rng.integers(8)
        if call == 0 and len(held) < 4:
            vertex = rng.choice(space.scene.free)
            point = X[vertex] + simulator.displacement([vertex])[0]
            target, stiffness = point + 0.1 * size * rng.normal(size=3), 10 ** rng.uniform(0, 2)
            held.append((simulator.grab(point, target, stiffness), solid.grab(point, target, stiffness)))
        elif call == 1 and held:
            handle, grab = held.pop(rng.integers(len(held)))
            handle.release(), solid.release(grab)
        elif call == 2 and held:
            handle, grab = held[rng.integers(len(held))]
            target = X[rng.choice(space.scene.free)] + 0.1 * size * rng.normal(size=3)
            handle.move(target), solid.move(grab, target)
        elif call == 3:
            simulator.gravity = gravity = 8 * rng.normal(size=3)
            solid.set_gravity(gravity)
        elif call == 4:
            simulator.material_scale = scale = 10 ** rng.uniform(-0.3, 1)
            solid.set_stiffness(scale)
        elif call == 5:
            saved.append((simulator.save(), solid.save(), list(held)))
        elif call == 6 and saved:
            before, state, held = saved[rng.integers(len(saved))]
            held = list(held)
            simulator.restore(before), solid.restore(state), other.restore(state)
            np.testing.assert_array_equal(other.displacements(), solid.displacements())
        else:
            simulator.step(), solid.step()
        np.testing.assert_allclose(solid.displacements(), simulator.displacement(), atol=1e-7 * size)
        for handle, grab in held:
            force = handle.force
            np.testing.assert_allclose(solid.force(grab), force, atol=1e-5 * (1.0 + np.linalg.norm(force)))


def test_a_model_without_landmarks_tells_no_novelty(library: Library) -> None:
    assert np.isnan(pair(library, linear())[1].novelty)


RESTORED = ["latent neo_hookean", "condensed neo_hookean", "latent with moving pins", "condensed, modes that swing"]


@pytest.mark.parametrize("name", RESTORED)
def test_a_restored_state_goes_on_to_the_last_bit_there_and_in_another_solid(library: Library, name: str) -> None:
    space = SPACES[name]()
    solid = pair(library, space)[1]
    size, point = space.scene.mesh.diagonal, tip(space)
    first = solid.grab(point, point + 0.1 * size, 40.0)
    solid.step()
    solid.release(first)
    kept = solid.grab(point, point + 0.2 * size, 40.0)
    solid.set_gravity([0, 0, -5])
    if space.lifting is not None:
        solid.move_pins(1, np.eye(3, 4) + 0.01)
    for _ in range(5):
        solid.step()
    saved = solid.save()

    def further(on: NativeSolid) -> Any:
        for step in range(12):
            if step == 5:
                on.move(kept, point - 0.1 * size)
            on.step()
        return on.displacements()

    expected = further(solid)
    solid.release(kept)
    solid.grab(space.scene.mesh.vertices.mean(axis=0), point)
    solid.set_stiffness(2.0)
    solid.step()
    other = NativeSolid(solid.model)
    for continued in (solid, other):
        continued.restore(saved)
        assert continued is solid or continued.save() == saved
        np.testing.assert_array_equal(further(continued), expected)


@pytest.mark.parametrize("name", [*(f"latent {name}" for name in MATERIALS), "condensed, modes that swing"])
def test_a_brutal_pull_comes_to_the_outcomes_of_the_simulator(library: Library, name: str) -> None:
    """So far and so hard that steps are lost, slowed or held; what stays finite in Python does so in C."""
    space = SPACES[name]()
    simulator, solid = pair(library, space)
    point, size = tip(space), space.scene.mesh.diagonal
    outcomes = []
    for k, way in ((1e7, 40.0), (1e9, -300.0), (1e12, 1e5)):
        simulator.reset()
        solid.reset()
        simulator.grab(point, point + way * size, k)
        solid.grab(point, point + way * size, k)
        for _ in range(4):
            outcomes.append((simulator.step().outcome, OUTCOMES[solid.step()[3]]))
            assert np.isfinite(solid.displacements()).all()
    assert {ours for ours, _ in outcomes} - {Outcome.SOLVED}
    # what is torn apart hangs on rounding, so not every single step is the same
    assert sum(ours == theirs for ours, theirs in outcomes) >= 0.7 * len(outcomes)


REFUSED: dict[str, tuple[Callable[[NativeSolid], Any], str]] = {
    "target": (lambda solid: solid.grab([0.0, 0.0, 0.0], [np.nan, 0, 0]), "an argument is out of range"),
    "stiffness": (lambda solid: solid.grab_vertices(np.array([19]), [0, 0, 0], -1.0), "an argument is out of range"),
    "no stiffness": (lambda solid: solid.grab([0.0, 0.0, 0.0], [0, 0, 0], 0.0), "stiffness is 0; it must be positive"),
    "vertex": (
        lambda solid: solid.grab_vertices(np.array([3, 20]), [0, 0, 0]),
        "from 3 to 20; they must be from 0 to 19",
    ),
    "vertex beyond 32 bits": (lambda solid: solid.grab_vertices(np.array([2**32]), [0, 0, 0]), "from 0 to 19"),
    "mask": (
        lambda solid: solid.grab_vertices(np.ones(20, bool), [0, 0, 0]),
        r"vertices are bool of the shape \(20,\)",
    ),
    "one target": (lambda solid: solid.grab([0.0, 0.0, 0.0], 1.0), "target is 1.0; it must be three numbers in m"),
    "moved to one": (lambda solid: solid.move(1, 1.0), "target is 1.0; it must be three numbers in m"),
    "no vertex": (lambda solid: solid.grab_vertices(np.array([], dtype=int), [0, 0, 0]), "an argument is out of"),
    "displaced vertex": (lambda solid: solid.displacement(np.array([-1])), "from -1 to -1; they must be from 0 to 19"),
    "displaced numbers": (lambda solid: solid.displacement(np.array([0.5])), "vertices are float64"),
    "far away": (lambda solid: solid.grab([99.0, 0, 0], [0, 0, 0]), "farther from the solid than half its diagonal"),
    "pinned": (lambda solid: solid.grab([-0.1, 0, 0], [0, 0, 0], 1.0, 1e-6), "all vertices there are pinned"),
    "moved": (lambda solid: solid.move(5, [0, 0, 0]), "there is no such grab"),
    "released": (lambda solid: solid.release(0), "there is no such grab"),
    "force": (lambda solid: solid.force(77), "there is no such grab"),
    "gravity": (lambda solid: solid.set_gravity([0, np.inf, 0]), "an argument is out of range"),
    "one gravity": (lambda solid: solid.set_gravity(-9.81), "gravity is -9.81; it must be three numbers in m/s²"),
    "gravity of two": (lambda solid: solid.set_gravity([0, -9.81]), "it must be three numbers in m/s²"),
    "map": (lambda solid: solid.move_pins(0, np.eye(3)), r"has the shape \(3, 3\); it must be \(3, 4\)"),
    "material": (lambda solid: solid.set_stiffness(0.0), "an argument is out of range"),
    "support": (lambda solid: solid.move_pins(0, np.eye(3, 4)), "there is no such support"),
    "state": (lambda solid: solid.restore(b"nothing"), "the saved state is of another model"),
    "cut state": (lambda solid: solid.restore(solid.save()[:-8]), "the saved state is of another model"),
    "changed state": (lambda solid: solid.restore(solid.save()[:-9] + b"9" * 9), "the saved state is of another model"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_done_is_refused_in_words_and_changes_nothing(library: Library, case: str) -> None:
    solid = pair(library, latent())[1]
    before = solid.save()
    act, words = REFUSED[case]
    with pytest.raises(SolverError, match=words):
        act(solid)
    assert solid.save() == before


@pytest.mark.parametrize("pulled", [False, True])
def test_a_condensed_solid_that_is_made_soft_stays_in_bounds_and_recovers_as_in_the_simulator(
    library: Library, monkeypatch: pytest.MonkeyPatch, pulled: bool
) -> None:
    monkeypatch.setattr(problems, "body", lambda name, resolution: scene(beam(resolution=resolution), name))
    space = with_linear_dents()
    simulator, solid = pair(library, space, ReducedOptions(tolerance=1e-8))
    size, point = space.scene.mesh.diagonal, tip(space)
    if pulled:
        simulator.grab(point, point + 0.1 * size, 50.0)
        solid.grab(point, point + 0.1 * size, 50.0)
    for scale in (0.1, 1.0, 1e-3, 1.0, 1e-9, 1.0):
        for _ in range(3):
            assert OUTCOMES[solid.step()[3]] == simulator.step().outcome
        simulator.material_scale = scale
        solid.set_stiffness(scale)
        np.testing.assert_allclose(solid.displacements(), simulator.displacement(), atol=1e-9 * size)
        assert np.abs(solid.displacements()).max() < 10 * size
    assert OUTCOMES[solid.step()[3]] == simulator.step().outcome == Outcome.SOLVED


def test_a_condensed_solid_whose_dead_load_alone_would_move_it_out_of_bounds_is_not_made_so_soft(
    library: Library,
) -> None:
    space = with_linear_dents()
    simulator, solid = pair(library, space)
    point = tip(space)
    simulator.grab(point, point + 0.01, 50.0)
    solid.grab(point, point + 0.01, 50.0)
    for _ in range(3):
        simulator.step()
        solid.step()
    before, u, saved = simulator.displacement(), solid.displacements(), solid.save()
    with pytest.raises(SceneError, match="material scale is 1e-06; so soft, the dead load alone moves the solid"):
        simulator.material_scale = 1e-6
    with pytest.raises(SolverError, match="so soft its dead load moves it there"):
        solid.set_stiffness(1e-6)
    np.testing.assert_array_equal(simulator.displacement(), before)
    np.testing.assert_array_equal(solid.displacements(), u)
    assert simulator.material_scale == 1 and solid.save() == saved
    assert OUTCOMES[solid.step()[3]] == simulator.step().outcome == Outcome.SOLVED


def test_a_state_of_a_solid_with_room_for_more_grabs_is_refused_and_told(library: Library) -> None:
    model = NativeModel(library, model_bytes(latent()))
    with pytest.raises(SolverError, match="of a solid that was not created for as many grabs"):
        NativeSolid(model, 2).restore(NativeSolid(model, 4).save())


def test_no_more_grabs_than_a_solid_was_made_for(library: Library) -> None:
    space = latent()
    solid = NativeSolid(NativeModel(library, model_bytes(space)), 1)
    first = solid.grab(tip(space), [0, 0, 0])
    with pytest.raises(SolverError, match="as many grabs as the solid was created for; release one"):
        solid.grab(tip(space), [0, 0, 0])
    solid.release(first)
    assert solid.grab(tip(space), [0, 0, 0]) != first


def test_a_state_of_another_model_is_refused(library: Library) -> None:
    one, other = pair(library, latent())[1], pair(library, latent("linear"))[1]
    with pytest.raises(SolverError, match="the saved state is of another model"):
        one.restore(other.save())


def test_every_code_has_words_of_its_own(library: Library) -> None:
    words = [library.functions.ldsim_message(code).decode() for code in range(20)]
    assert len(set(words)) == 20 and "there is no such code" not in words
    assert library.functions.ldsim_message(20).decode() == "there is no such code"
