"""The session: a space that is turned on goes on where the others are, and beside the full one it is judged."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.simulate import simulate
from ldsim.errors import LdsimError, SceneError
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.recording import read_recording
from ldsim.simulator import Simulator, full_simulator, load
from ldsim.viewer import protocol
from ldsim.viewer.colours import Colours, rounded_up
from ldsim.viewer.payload import field_bytes
from ldsim.viewer.player import PlayedMotion
from ldsim.viewer.recorder import Recorder
from ldsim.viewer.serving import serve
from ldsim.viewer.session import Session
from ldsim.viewer.state import Audience, Errors
from tests.helpers import bent
from tests.simulator.playable import solid


@pytest.fixture
def said() -> list[str]:
    """What the page is told."""
    return []


@pytest.fixture
def session(playable: Path, said: list[str]) -> Session:
    session = Session(lambda space: load(playable, space), ["latent", "linear", "full"], [load(playable, "linear")])
    session._audience = Audience(lambda _: None, lambda _, __: None, lambda _: None, said.append)
    return session


def pull(session: Session, simulator: Simulator) -> None:
    tip = simulator.surface.rest[simulator.surface.rest[:, 0].argmax()]
    to = tip + [0.0, 0.05, 0.0]
    session.tell(1, protocol.GrabMessage(id=5, point=tuple(tip.tolist()), target=tuple(to.tolist())))
    session.obey()


def test_a_space_that_is_turned_on_takes_over_pose_pulls_and_time(session: Session) -> None:
    (linear,) = session._shown
    pull(session, linear)
    for _ in range(6):
        session.step()
    before = linear.displacement()
    session.tell(1, protocol.SpacesMessage(value=("linear", "full")))
    session.obey()
    full = session._shown[1]
    assert session._shown[0] is linear and np.abs(before).max() > 1e-3
    np.testing.assert_array_equal(linear.displacement(), before)
    np.testing.assert_allclose(full.displacement(), before, atol=1e-9)
    np.testing.assert_allclose(full.velocity(), linear.velocity(), atol=1e-6)
    assert session._simulated == pytest.approx(6 * linear.scene.time_step) and full.time == linear.time
    (held,) = session.hands.held.values()
    assert [handle.grab.target.tolist() for handle in held.handles] == [held.target.tolist()] * 2
    session.tell(1, protocol.ReleaseMessage(id=5))
    session.obey()
    assert not linear.grabs and not full.grabs


def test_beside_the_full_space_the_error_is_told_now_and_so_far(playable: Path) -> None:
    linear, full = load(playable, "linear"), load(playable, "full")
    errors, off, moved = Errors(), [], []
    assert np.isnan(errors.of("linear")).all()
    for _ in range(4):
        linear.step()
        full.step()
        errors.add([linear, full])
        off.append(np.linalg.norm(linear.displacement() - full.displacement(), axis=1).mean())
        moved.append(np.linalg.norm(full.displacement(), axis=1).mean())
    assert errors.of("linear") == (pytest.approx(off[-1]), pytest.approx(sum(off) / sum(moved)))
    assert np.isnan(errors.of("full")).all()
    errors.add([linear])
    assert np.isnan(errors.of("linear")).all()


def test_a_pull_at_a_pinned_place_is_told(session: Session, said: list[str]) -> None:
    scene = session._shown[0].scene
    point = tuple(scene.mesh.vertices[scene.pinned][0].tolist())
    session.tell(1, protocol.GrabMessage(id=1, point=point, target=point))
    session.obey()
    assert len(said) == 1 and "pinned" in said[0]


def test_a_page_that_leaves_lets_go_however_many_messages_wait(session: Session) -> None:
    pull(session, session._shown[0])
    assert session.hands.held
    waiting = 0
    while session.tell(2, protocol.SwitchMessage(kind="pause", value=False)):
        waiting += 1
        assert waiting < 100_000
    assert session.tell(1, None)
    session.obey()
    assert not session.hands.held and not session._shown[0].grabs


def test_a_pull_that_goes_on_while_a_space_opens_costs_no_connection_and_lets_go(session: Session) -> None:
    pull(session, session._shown[0])
    assert all(session.tell(1, protocol.MoveMessage(id=5, target=(0.1, 0.0, 0.0))) for _ in range(5000))
    assert session.tell(1, protocol.ReleaseMessage(id=5))
    session.obey()
    assert not session.hands.held


def test_a_stiffness_that_a_space_refuses_is_set_in_none(
    session: Session, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scaled = Simulator._scaled
    told(session, protocol.SpacesMessage(value=("full", "linear")))

    def refusing(simulator: Simulator, state: object, scale: float) -> object:
        if scale < 0.5 and simulator.space.name == "linear":
            raise SceneError("too soft")
        return scaled(simulator, state, scale)

    monkeypatch.setattr(Simulator, "_scaled", refusing)
    told(session, protocol.NumberMessage(kind="stiffness", value=0.1))
    assert said[-1] == "too soft" and session.look.stiffness == 1.0
    assert [simulator.material_scale for simulator in session._shown] == [1.0, 1.0]


def told(session: Session, *messages: protocol.Message) -> None:
    for message in messages:
        session.tell(1, message)
    session.obey()


def stepped(session: Session, count: int) -> None:
    for _ in range(count):
        session.step()


def test_undo_goes_back_to_before_the_last_pull_and_the_one_before_that(session: Session, said: list[str]) -> None:
    (linear,) = session._shown
    stepped(session, 3)
    first = linear.save()
    pull(session, linear)
    stepped(session, 4)
    kept = session.hands.held[5].target
    second, shape = linear.save(), linear.displacement()
    told(session, protocol.ButtonMessage(kind="reset"))
    stepped(session, 2)
    assert not linear.grabs
    told(session, protocol.ButtonMessage(kind="undo"))
    np.testing.assert_array_equal(linear.displacement(), shape)
    assert linear.time == second.number * linear.scene.time_step == pytest.approx(session._simulated)
    np.testing.assert_array_equal(session.hands.held[5].handles[0].target, kept)
    told(session, protocol.SpacesMessage(value=("full",)), protocol.ButtonMessage(kind="undo"))
    (full,) = session._shown
    assert full.space.name == "full" and not full.grabs and not session.hands.held
    linear.restore(first)
    np.testing.assert_allclose(full.displacement(), linear.displacement(), atol=1e-9)
    told(session, protocol.ButtonMessage(kind="undo"))
    assert len(said) == 2 and said[-1].startswith("nothing to undo")  # the first told that a space is opened


def test_a_pull_that_hits_nothing_leaves_nothing_to_undo(session: Session, said: list[str]) -> None:
    told(session, protocol.GrabMessage(id=1, point=(99.0, 0.0, 0.0), target=(0.0, 0.0, 0.0)))
    told(session, protocol.ButtonMessage(kind="undo"))
    assert len(said) == 2 and "hits no vertex" in said[0] and said[1].startswith("nothing to undo")


def test_an_undo_keeps_gravity_and_stiffness_as_they_are_now(session: Session) -> None:
    (linear,) = session._shown
    pull(session, linear)
    told(session, protocol.GravityMessage(value=(0, 0, 1)), protocol.NumberMessage(kind="stiffness", value=2.0))
    told(session, protocol.ButtonMessage(kind="undo"))
    assert linear.gravity.tolist() == [0, 0, 1] and linear.material_scale == 2.0


@pytest.mark.parametrize("shown", ["linear", "full"])
def test_an_undo_brings_back_no_pull_of_a_page_that_has_left(session: Session, shown: str) -> None:
    """Which nobody could let go; what another page holds comes back."""
    (linear,) = session._shown
    pull(session, linear)
    other = tuple(linear.surface.rest[linear.surface.rest[:, 0].argmax()].tolist())
    session.tell(2, protocol.GrabMessage(id=6, point=other, target=other))
    session.tell(2, protocol.ButtonMessage(kind="reset"))
    session.tell(1, None)
    session.tell(2, protocol.SpacesMessage(value=(shown,)))
    session.tell(2, protocol.ButtonMessage(kind="undo"))
    session.obey()
    (simulator,) = session._shown
    assert simulator.space.name == shown and list(session.hands.held) == [6]
    assert [grab.target.tolist() for grab in simulator.grabs] == [list(other)]


def a_motion(simulator: Simulator) -> Motion:
    tip = simulator.surface.rest[simulator.surface.rest[:, 0].argmax()]
    targets = tip + np.linspace(0, 0.05, 4)[:, None] * [0.0, 1.0, 0.0]
    down = np.tile([0.0, -3.0, 0.0], (6, 1))
    return Motion("up", 6, (Drag(1, tip, targets, 0.03, 25.0),), gravity=down)


def test_a_motion_of_the_run_is_played_in_every_space_as_it_ran(session: Session) -> None:
    motion = a_motion(session._shown[0])
    session.player.add("up", PlayedMotion(motion, "test"))
    told(session, protocol.SpacesMessage(value=("linear", "full")))
    stepped(session, 2)
    told(session, protocol.SwitchMessage(kind="replay", value=True))
    stepped(session, 6)
    linear, full = session._shown
    expected = list(simulate(FullStepper(full.scene), motion))[-1].state.u
    np.testing.assert_allclose(full.displacement(), expected, atol=1e-7)
    assert np.abs(expected).max() > 1e-3 and not linear.grabs  # the drag is over
    assert session.status()["player"] == {"playing": True, "motions": {"up": "test"}, "chosen": "up"}
    stepped(session, 1)
    assert not session.player.playing and full.gravity.tolist() == list(session.look.gravity)


def test_an_undo_of_a_reset_or_a_second_start_leaves_no_pull_of_the_motion_behind(session: Session) -> None:
    """Which no page would show, and nobody could let go."""
    (linear,) = session._shown
    session.player.add("up", PlayedMotion(a_motion(linear)))
    for again in (protocol.ButtonMessage(kind="reset"), protocol.SwitchMessage(kind="replay", value=True)):
        told(session, protocol.SwitchMessage(kind="replay", value=True))
        stepped(session, 3)
        assert linear.grabs
        told(session, again, protocol.ButtonMessage(kind="undo"))
        assert not linear.grabs and not session.hands.held and not session.player.playing


def test_a_hand_ends_the_motion_that_is_played_and_its_pull_is_shown_until_then(session: Session) -> None:
    session.player.add("up", PlayedMotion(a_motion(session._shown[0])))
    told(session, protocol.SwitchMessage(kind="replay", value=True))
    stepped(session, 3)
    (shown,) = session._played_grabs()
    np.testing.assert_array_equal(shown.target, session._shown[0].grabs[0].target)
    with pytest.raises(LdsimError, match="gravity stays as it is while a motion is recorded or played"):
        session._do(1, protocol.GravityMessage(value=(0, 0, 0)))
    pull(session, session._shown[0])
    assert not session.player.playing and len(session._shown[0].grabs) == len(session.hands.held) == 1
    told(session, protocol.ButtonMessage(kind="undo"), protocol.ButtonMessage(kind="undo"))
    assert session._simulated == 0.0


@pytest.fixture
def recording(tmp_path: Path, said: list[str]) -> Session:
    """On the full space of a beam, into m.csv; further spaces are offered, and cannot be opened."""
    simulator = full_simulator(solid(1))

    def missing(space: str) -> Simulator:
        raise LdsimError(f"there is no {space} space")

    session = Session(missing, ["full", "latent"], [simulator], Recorder(tmp_path / "m.csv", (25.0, 0.03), {}))
    session._audience = Audience(lambda _: None, lambda _, __: None, lambda _: None, said.append)
    return session


def hold(session: Session, at: tuple[float, float, float]) -> protocol.GrabMessage:
    """Pull upward at the vertex that is nearest at rest, with the one hand of a recording."""
    simulator = session._shown[0]
    vertices = simulator.scene.mesh.vertices
    point = vertices[np.linalg.norm(vertices - at, axis=1).argmin()]
    target = point + [0.0, 0.02, 0.0]
    message = protocol.GrabMessage(id=1, point=tuple(point.tolist()), target=tuple(target.tolist()))
    told(session, message)
    return message


RECORD, STOP = (protocol.SwitchMessage(kind="record", value=value) for value in (True, False))


def test_a_recording_does_not_go_back_to_rest_under_the_hand(
    recording: Session, said: list[str], tmp_path: Path
) -> None:
    told(recording, RECORD)
    first = hold(recording, (1.0, 0.0, 0.0))
    stepped(recording, 3)
    moved = recording._shown[0].displacement()
    told(recording, protocol.ButtonMessage(kind="reset"))
    assert said[-1] == "a recording does not go back to rest; stop it, then record another take"
    np.testing.assert_array_equal(recording._shown[0].displacement(), moved)
    hold(recording, (0.5, 0.0, 0.0))  # there is but one hand, and it still holds
    stepped(recording, 2)
    told(recording, STOP)
    (drag,) = read_recording(tmp_path / "m.csv", "m").drags
    np.testing.assert_array_equal(drag.point, first.point)
    np.testing.assert_array_equal(drag.targets, [first.target] * 5)


def test_a_recording_begins_with_the_gravity_and_the_stiffness_of_the_configuration(
    recording: Session, tmp_path: Path
) -> None:
    """Its file holds neither."""
    (simulator,) = recording._shown
    own = simulator.scene.gravity.tolist()
    told(recording, protocol.GravityMessage(value=(0, 0, 1)), protocol.NumberMessage(kind="stiffness", value=2.0))
    assert simulator.gravity.tolist() == [0, 0, 1] and simulator.material_scale == 2.0
    told(recording, RECORD)
    assert simulator.gravity.tolist() == own and simulator.material_scale == 1.0
    assert list(recording.look.gravity) == own and recording.look.stiffness == 1.0  # as the controls show it
    hold(recording, (1.0, 0.0, 0.0))
    stepped(recording, 4)
    felt = simulator.displacement()
    told(recording, STOP)
    replayed = list(simulate(FullStepper(simulator.scene), read_recording(tmp_path / "m.csv", "m")))[-1].state.u
    np.testing.assert_allclose(felt, replayed, atol=1e-7)


def test_a_recording_that_runs_is_not_begun_anew_and_one_that_ended_not_ended_again(
    recording: Session, said: list[str], tmp_path: Path
) -> None:
    told(recording, STOP)
    assert not said
    told(recording, RECORD)
    hold(recording, (1.0, 0.0, 0.0))
    stepped(recording, 3)
    told(recording, RECORD)
    stepped(recording, 2)
    told(recording, STOP)
    hold(recording, (1.0, 0.0, 0.0))
    stepped(recording, 1)
    told(recording, STOP)
    assert recording.hands.held and len(said) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["m.csv"]
    motion = read_recording(tmp_path / "m.csv", "m")
    assert motion.frames == 5 and [(drag.start, drag.stop) for drag in motion.drags] == [(0, 5)]


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (protocol.NumberMessage(kind="stiffness", value=3.0), "stiffness stays as it is"),
        (protocol.GravityMessage(value=(0.0, 0.0, 0.0)), "gravity stays as it is"),
        (protocol.SpacesMessage(value=("full", "latent")), "there is no latent space"),
    ],
    ids=["stiffness", "gravity", "space"],
)
def test_what_is_refused_is_followed_by_what_the_controls_shall_show(
    recording: Session, said: list[str], message: protocol.Message, words: str
) -> None:
    told(recording, RECORD)
    statuses: list[dict[str, object]] = []
    recording._audience.status = statuses.append
    before = recording.status()
    told(recording, message)
    assert words in said[-1] and statuses == [before]


def test_a_take_that_cannot_be_written_leaves_the_button_to_record_another(
    recording: Session, said: list[str], tmp_path: Path
) -> None:
    told(recording, RECORD)
    stepped(recording, 2)
    tmp_path.rmdir()
    tmp_path.touch()
    statuses: list[dict[str, object]] = []
    recording._audience.status = statuses.append
    told(recording, STOP)
    assert "m.csv cannot be written" in said[-1]
    assert [status["recorder"] for status in statuses] == [{"recording": False, "file": "m.csv"}]


def test_an_error_in_a_step_ends_a_recording_with_the_frames_before_it(
    recording: Session, said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told(recording, RECORD)
    first = hold(recording, (1.0, 0.0, 0.0))
    stepped(recording, 3)
    with monkeypatch.context() as broken:
        broken.setattr(Simulator, "step", lambda _: 1 / 0)
        recording._tick(1.0)
    path = tmp_path / "m.csv"
    assert said[-1].endswith(
        f"in a step: {ZeroDivisionError('division by zero')!r}; the recording ends before it, {path}: 3 frames, 1 pull"
    )
    hold(recording, (0.5, 0.0, 0.0))
    stepped(recording, 2)
    motion = read_recording(path, "m")
    np.testing.assert_array_equal(motion.drags[0].targets, [first.target] * 3)
    assert motion.frames == 3 and not recording._recording


def test_the_end_of_the_session_writes_a_recording_that_runs_and_says_so(recording: Session, tmp_path: Path) -> None:
    told(recording, RECORD)
    first = hold(recording, (1.0, 0.0, 0.0))
    stepped(recording, 3)
    recording.stop()
    recording.run()
    assert recording.farewell == f"the recording ends here, {tmp_path / 'm.csv'}: 3 frames, 1 pull"
    np.testing.assert_array_equal(read_recording(tmp_path / "m.csv", "m").drags[0].targets, [first.target] * 3)


def test_what_becomes_of_a_recording_at_the_end_is_told_on_the_command_line() -> None:
    class Ending:
        farewell = "the recording ends here, m.csv: 3 frames, 1 pull"

        def end(self) -> None: ...

        async def run(self, ready: object) -> None: ...

    said: list[str] = []
    server: Any = Ending()
    serve(server, False, said.append, said.append)
    assert said == [Ending.farewell, "stopped"]


def test_where_energy_is_infinite_the_others_still_make_the_scale() -> None:
    simulator: Any = full_simulator(solid(1))
    mesh, u = simulator.scene.mesh, 0.1 * bent(simulator.scene.mesh)
    u[mesh.vertices[:, 0].argmax(), 0] = -0.9 * np.ptp(mesh.vertices[:, 0])
    shown: Any = SimpleNamespace(displacement=lambda: u, material_scale=1.0)
    colours = Colours(simulator.scene, simulator.surface)
    colours._time = -np.inf
    (found,) = colours.of("energy", [shown])
    low, high = np.frombuffer(found, "<f4", 2, 4)
    shades = np.frombuffer(found, np.uint8, offset=12)
    assert low == 0 and 0 < high < np.inf and shades.max() == 255 > shades.min()
    assert field_bytes(0, np.array([0.0, np.inf, np.nan]), 0.0, 1.0)[12:] == bytes([0, 255, 255])


@pytest.mark.parametrize(("value", "expected"), [(0.0, 0.0), (1.0, 1.0), (1.01, 2.0), (420.0, 500.0), (0.0051, 0.01)])
def test_the_scale_of_colours_grows_by_round_steps(value: float, expected: float) -> None:
    assert rounded_up(value) == pytest.approx(expected)
