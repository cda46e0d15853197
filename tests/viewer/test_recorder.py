"""Recording by hand: what is written is what was done, and is replayed as it was felt."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.simulate import simulate
from ldsim.errors import MotionError
from ldsim.mechanics.recording import read_recording
from ldsim.simulator import Simulator, full_simulator
from ldsim.viewer.recorder import Recorder
from tests.simulator.playable import solid

BODY = solid(1)
TIP = BODY.mesh.vertices[BODY.mesh.vertices[:, 0].argmax()]


def steps(recorder: Recorder, simulator: Simulator, count: int) -> None:
    for _ in range(count):
        recorder.player.prepare([simulator])
        simulator.step()
        recorder.note()


def record(path: Path) -> tuple[Recorder, Simulator, Array]:
    """Two pulls, the second without a frame after the first; the displacement at the end."""
    simulator = full_simulator(BODY)
    recorder = Recorder(path, (25.0, 0.03), {"recorded_on": "beam"})
    recorder.record(True)
    steps(recorder, simulator, 2)
    for lift in (0.03, -0.02):
        point = TIP + simulator.displacement()[np.linalg.norm(BODY.mesh.vertices - TIP, axis=1).argmin()]
        handle = recorder.grab(simulator, point, point)
        for i in range(4):
            target = point + np.array([0.0, lift * i / 3, 0.0])
            handle.move(target)
            recorder.move(target)
            steps(recorder, simulator, 1)
        handle.release()
        recorder.release()
    steps(recorder, simulator, 3)
    u = simulator.displacement()
    assert "2 pulls" in recorder.record(False)
    return recorder, simulator, u


def test_a_recording_replayed_in_the_full_space_ends_where_the_hand_left_it(tmp_path: Path) -> None:
    _, _, u = record(tmp_path / "m.csv")
    motion = read_recording(tmp_path / "m.csv", "m")
    assert motion.frames == 2 + 4 + 1 + 4 + 3
    assert [drag.start for drag in motion.drags] == [2, 7]
    frames = list(simulate(FullStepper(BODY), motion))
    np.testing.assert_allclose(frames[-1].state.u, u, atol=1e-8)
    assert np.abs(u).max() > 1e-3


def test_playing_back_repeats_it_and_ends(tmp_path: Path) -> None:
    recorder, simulator, u = record(tmp_path / "m.csv")
    simulator.reset()
    recorder.player.play([simulator])
    steps(recorder, simulator, 14)
    np.testing.assert_allclose(simulator.displacement(), u, atol=1e-8)
    assert recorder.player.playing
    steps(recorder, simulator, 1)
    assert not recorder.player.playing and not simulator.grabs


def test_a_grab_that_lasts_no_frame_leaves_no_trace(tmp_path: Path) -> None:
    simulator, recorder = full_simulator(BODY), Recorder(tmp_path / "m.csv", (25.0, 0.03), {})
    recorder.record(True)
    recorder.grab(simulator, TIP, TIP).release()
    recorder.release()
    steps(recorder, simulator, 2)
    recorder.record(False)
    assert read_recording(tmp_path / "m.csv", "m").drags == ()


def test_with_nothing_recorded_there_is_nothing_to_play(tmp_path: Path) -> None:
    with pytest.raises(MotionError, match="nothing to play"):
        Recorder(tmp_path / "m.csv", (25.0, 0.03), {}).player.play([full_simulator(BODY)])


def test_a_file_that_cannot_be_written_is_told_before_anything_is_recorded(tmp_path: Path) -> None:
    with pytest.raises(MotionError, match="cannot be written"):
        Recorder(tmp_path / "nowhere" / "m.csv", (25.0, 0.03), {})


def test_a_take_that_cannot_be_written_is_told_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, text: str, encoding: str) -> None:
        path.write_bytes(text[:50].encode(encoding))
        raise OSError(errno.ENOSPC, "No space left on device")

    recorder, simulator = Recorder(tmp_path / "m.csv", (25.0, 0.03), {}), full_simulator(BODY)
    recorder.record(True)
    steps(recorder, simulator, 2)
    with monkeypatch.context() as disk:
        disk.setattr(Path, "write_text", full)
        with pytest.raises(MotionError, match=r"m\.csv cannot be written: No space left on device; this take is lost"):
            recorder.record(False)
    assert not any(tmp_path.iterdir()) and not recorder.recording and not recorder.player.pieces
    recorder.record(True)
    steps(recorder, simulator, 2)
    recorder.record(False)
    assert [path.name for path in tmp_path.iterdir()] == ["m.csv"]


def test_a_take_without_frames_is_not_written(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "m.csv", (25.0, 0.03), {})
    recorder.record(True)
    assert recorder.record(False) == "nothing was recorded, as no time went by; no file is written"
    assert not any(tmp_path.iterdir()) and not recorder.recording and not recorder.player.pieces


def test_a_take_replaces_no_file(tmp_path: Path) -> None:
    for name in ("m.csv", "m-3.csv"):
        (tmp_path / name).write_text("by hand")
    recorder, simulator = Recorder(tmp_path / "m.csv", (25.0, 0.03), {}), full_simulator(BODY)
    for expected in ("m-2.csv", "m-4.csv"):
        assert recorder.status()["file"] == expected
        recorder.record(True)
        steps(recorder, simulator, 2)
        assert expected in recorder.record(False)
    assert {name: (tmp_path / name).read_text() for name in ("m.csv", "m-3.csv")} == {
        "m.csv": "by hand",
        "m-3.csv": "by hand",
    }
    assert read_recording(tmp_path / "m-4.csv", "m").frames == 2


def test_every_recording_is_a_take_until_it_is_deleted(tmp_path: Path) -> None:
    recorder, simulator, _ = record(tmp_path / "m.csv")
    recorder.record(True)
    steps(recorder, simulator, 5)
    recorder.record(False)
    player = recorder.player
    assert player.status()["motions"] == {"m": "14 frames", "m-2": "5 frames"} and player.chosen == "m-2"
    assert read_recording(tmp_path / "m.csv", "m").frames == 14
    player.choose("m")
    player.play([simulator])
    steps(recorder, simulator, 14)
    with pytest.raises(MotionError, match="a motion is being played"):
        recorder.discard("m")
    player.stop([simulator])
    recorder.discard("m")
    assert player.chosen == "m-2" and not (tmp_path / "m.csv").exists() and (tmp_path / "m-2.csv").exists()
    with pytest.raises(MotionError, match="there is no motion 'm' to play; there are m-2"):
        player.choose("m")


def test_a_motion_that_was_given_is_forgotten_but_its_file_is_kept(tmp_path: Path) -> None:
    record(tmp_path / "given.csv")
    given = read_recording(tmp_path / "given.csv", "given")
    recorder = Recorder(tmp_path / "m.csv", (25.0, 0.03), {}, given)
    recorder.discard("given")
    assert recorder.player.pieces == {} and (tmp_path / "given.csv").exists()
