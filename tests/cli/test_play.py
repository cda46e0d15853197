"""`ldsim play` and `ldsim record` as a user starts them, and what they refuse."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest
import yaml

from ldsim.mechanics.motion import Motion
from ldsim.mechanics.recording import write_recording
from ldsim.pipeline.files import resolve_path
from ldsim.pipeline.mesh import described_scene
from ldsim.pipeline.progress import SILENT
from ldsim.settings import load_settings
from ldsim.settings.record import RecordOptions, recording_scene
from ldsim.simulator import full_simulator
from tests.cli.experiments import TINY, Experiment, invoked, refused
from tests.report.small_run import write_run

ONE = (
    "MeshVersionFormatted 1\nDimension 3\nVertices\n4\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n"
    "Tetrahedra\n1\n1 2 3 4 0\nEnd\n"
)
TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"


def config(folder: Path) -> Path:
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump(TINY), encoding="utf-8")
    return path


def started(*arguments: str, **environment: str) -> tuple[str, str, str, int]:
    """Start a command, fetch its page, interrupt it: the page, what it printed and said, and its exit status."""
    command = [sys.executable, "-m", "ldsim", *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, env={**os.environ, **environment}, **pipes)  # type: ignore[call-overload]
    before, url = "", process.stdout.readline().strip()
    while process.poll() is None and not url.startswith("http"):
        before, url = f"{before}{url}\n", process.stdout.readline().strip()
    try:
        with urllib.request.urlopen(url, timeout=60) as answer:
            page = answer.read().decode()
    finally:
        process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    return page, f"{before}{url}\n{out}", err, process.returncode


def test_play_prints_the_address_serves_the_page_and_stops_when_interrupted(playable: Path) -> None:
    page, out, _, status = started("play", str(playable), "--no-browser")
    assert "<canvas" in page
    assert out.startswith("http://127.0.0.1:") and out.endswith("stopped\n")
    assert status == 0


def test_record_serves_a_page_for_a_configuration_and_for_a_mesh_file(tmp_path: Path) -> None:
    mesh = tmp_path / "one.mesh"
    mesh.write_text(ONE)
    for source in (config(tmp_path), mesh):
        page, _, _, status = started("record", str(source), "--no-browser", "--output", str(tmp_path / "m.csv"))
        assert "<canvas" in page and status == 0


def test_without_a_browser_the_address_is_all_there_is(playable: Path) -> None:
    _, out, err, status = started("play", str(playable), BROWSER="/bin/false", DISPLAY="", WAYLAND_DISPLAY="", PATH="")
    assert status == 0 and out.startswith("http://")
    assert "no browser could be started here; open the address above in one" in err


@pytest.mark.parametrize(("percent", "expected"), [("0.001", 3), ("1e6", 0)])
def test_make_plays_what_it_made_and_says_first_where_it_is_not_as_good_as_asked(
    experiment: Experiment, percent: str, expected: int
) -> None:
    runs = str(experiment.folder / "runs")
    arguments = ["make", str(experiment.config), "--runs", runs, "--error", percent, "--play"]
    page, out, err, status = started(*arguments, BROWSER="/bin/true")
    assert "<canvas" in page and status == expected
    assert out.endswith("/\nstopped\n")
    missed, opened = err.find(f"asked were {percent} %"), err.find(f"opening {experiment.run}")
    assert opened > missed and (missed >= 0) == (expected == 3)


def refusal(*arguments: str) -> str:
    return refused(invoked(*arguments))


def test_a_run_without_a_model_is_refused(playable: Path, tmp_path: Path) -> None:
    (tmp_path / "scene.h5").write_bytes((playable / "scene.h5").read_bytes())
    assert "basis.h5 does not exist; run `ldsim pca` first" in refusal("play", str(tmp_path))


@pytest.mark.parametrize("command", [["play"], ["export", "--playground"], ["export", "--format", "npz"]], ids=" ".join)
def test_a_run_that_was_not_trained_is_refused_with_what_to_run(tmp_path: Path, command: list[str]) -> None:
    write_run(tmp_path)
    (tmp_path / "model.h5").unlink()
    assert "model.h5 does not exist; run `ldsim train` first" in refusal(*command, str(tmp_path))
    assert not any((tmp_path / "export").rglob("*"))


@pytest.mark.parametrize("name", ["nothing", "nothing/at/all"])
def test_a_folder_that_is_no_run_is_refused(tmp_path: Path, name: str) -> None:
    assert "is not the folder of a run" in refusal("play", str(tmp_path / name))


def test_a_port_in_use_is_refused(playable: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"port {port}: it is in use; choose another" in refusal("play", str(playable), "--port", str(port))


def test_record_refuses_what_it_cannot_use(tmp_path: Path) -> None:
    given = config(tmp_path)
    mine = tmp_path / "mine.csv"
    write_recording(mine, Motion("mine", 3, ()))
    before = mine.read_bytes()
    for arguments, words in (
        (["record", str(tmp_path / "no.yaml")], "does not exist"),
        (["record", str(tmp_path / "no.mesh")], "no.mesh"),
        (["record", str(given), "--play", str(tmp_path / "no.csv")], "no.csv cannot be read"),
        (["record", str(given), "--mesh", str(tmp_path / "no.mesh")], "no.mesh"),
        (["record", str(given), "--resolution", "0"], "resolution: input should be greater than or equal to 1, got 0"),
        (["record", str(given), "--resolution", "24"], "up to 3000 can be recorded on by hand"),
        (["record", str(given), "--output", str(tmp_path / "no" / "m.csv")], "cannot be written"),
        (["record", str(given), "--output", str(mine)], f"{mine} exists already; give another --output"),
        (["record", str(given), "--play", str(mine), "--output", str(mine)], f"{mine} exists already"),
        (["record", str(given), "--pin", "x-min"], f"--pin is for a mesh or surface file; {given} says it itself"),
        (["record", str(given), "--mesh", "a.mesh", "--resolution", "2"], "give one of --mesh and --resolution"),
    ):
        assert words in refusal(*arguments, "--no-browser")
    assert mine.read_bytes() == before


def test_without_an_output_a_take_goes_to_the_first_free_name_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    served = []
    monkeypatch.setattr("ldsim.cli.record.serve", lambda server, *_: served.append(server))
    given = config(tmp_path)
    monkeypatch.chdir(tmp_path)
    for expected in ("motion.csv", "motion-2.csv"):
        played = ["--play", "motion.csv"] if served else []
        result = invoked("record", str(given), *played)
        assert result.exit_code == 0, result.output
        recorder = served[-1]._session.recorder
        recorder.record(True)
        recorder.note()
        assert recorder.record(False).startswith(f"{expected}: 1 frame")


@pytest.mark.parametrize(("name", "content"), [("one.mesh", ONE), ("a solid.off", TETRAHEDRON)])
def test_a_mesh_or_a_surface_becomes_a_configuration_whose_stages_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: str
) -> None:
    served = []
    monkeypatch.setattr("ldsim.cli.record.serve", lambda server, *_: served.append(server))
    if name.endswith(".off"):
        pytest.importorskip("pytetwild", reason="fTetWild is not installed: pip install 'ldsim[surface]'")
    source, made = tmp_path / name, tmp_path / "configs" / "made.yaml"
    source.write_text(content, encoding="utf-8")
    motion = tmp_path / "m.csv"
    arguments = ["record", str(source), "--unit", "m", "--config", str(made), "--output", str(motion)]
    result = invoked(*arguments, *(["--cells", "40"] if name.endswith(".off") else []))
    assert result.exit_code == 0 and len(served) == 1, result.output
    assert not made.exists()  # a page that is closed unrecorded leaves nothing behind
    recorder = served[0]._session.recorder
    for _ in range(2):
        recorder.record(True)
        recorder.note()
        recorder.record(False)
    assert load_settings(made).snapshot.motions[1].recording == "../m-2.csv"
    recorder.discard("m-2")
    settings = load_settings(made)
    assert settings.experiment == "made"
    assert settings.snapshot.roles == ("train", "train", "train", "validation", "test")
    assert resolve_path(settings.snapshot.motions[0].recording or "", made.parent).resolve() == motion.resolve()
    made.write_text(made.read_text(encoding="utf-8").replace("cells: 10000", "cells: 60"), encoding="utf-8")
    done = invoked("mesh", str(made), "--runs", str(tmp_path / "runs"))
    assert done.exit_code == 0, done.output
    assert "exists already; give --config another name" in refusal(*arguments)
    recorder.discard("m")
    assert not made.exists()


def test_a_solid_that_is_recorded_on_is_that_of_the_configuration(tmp_path: Path) -> None:
    source, made = tmp_path / "one.mesh", tmp_path / "one.yaml"
    source.write_text(ONE, encoding="utf-8")
    options = RecordOptions(pin="z-min", output=tmp_path / "m.csv", config=made, youngs_modulus=2e6)
    scene, recorder = recording_scene(source, options)
    recorder.record(True)
    recorder.note()
    recorder.record(False)
    again, _ = described_scene(load_settings(made).mesh, SILENT, tmp_path)
    assert tuple(scene.gravity) == (0, 0, -9.8)
    assert scene.time_step == again.time_step
    for name in ("mu", "lam", "pinned", "external_force"):
        np.testing.assert_array_equal(getattr(scene, name), getattr(again, name))


@pytest.mark.parametrize(("said", "held"), [({}, (30.0, 0.03)), ({"stiffness": 3.0, "radius": 0.2}, (3.0, 0.2))])
def test_a_hand_pulls_like_the_pulls_of_its_configuration_unless_told_otherwise(
    said: dict[str, float], held: tuple[float, float], tmp_path: Path
) -> None:
    scene, recorder = recording_scene(config(tmp_path), RecordOptions(output=tmp_path / "m.csv", **said))
    tip = scene.mesh.vertices[scene.free[-1]]
    grab = recorder.grab(full_simulator(scene), tip, tip).grab
    near = np.linalg.norm(scene.mesh.vertices - tip, axis=1) <= held[1]
    np.testing.assert_array_equal(grab.vertices, np.flatnonzero(near & scene.movable))
    assert grab.stiffness == held[0]


def test_what_makes_up_a_configuration_is_refused_for_one(tmp_path: Path) -> None:
    given = str(config(tmp_path))
    assert "is a configuration already" in refusal("record", given, "--config", str(tmp_path / "b.yaml"))
    assert "--cells needs mesh.surface" in refusal("record", given, "--cells", "100")


@pytest.mark.parametrize(
    ("command", "words"), [("make", "is a folder"), ("record", "is a folder; give a mesh, a surf")]
)
def test_a_folder_in_the_place_of_a_file(tmp_path: Path, command: str, words: str) -> None:
    assert words in refused(invoked(command, str(tmp_path)))
    assert words in refused(invoked(command, "."))
