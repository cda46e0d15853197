"""`ldsim report`: the folder it writes, what it refuses, and what a crash leaves behind."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest
from click.testing import Result

from ldsim.report.schema import check_report
from tests.cli.experiments import invoked
from tests.report.small_run import CONFIG, FRAMES, NAME, write_run


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("finished")
    (root / "config.yaml").write_text(CONFIG)
    (root / "runs" / NAME).mkdir(parents=True)
    write_run(root / "runs" / NAME)
    return root


@pytest.fixture
def root(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished run, free to be broken."""
    copy = tmp_path / "work"
    shutil.copytree(finished, copy)
    return copy


def report(root: Path) -> Result:
    return invoked("report", str(root / "config.yaml"), "--runs", str(root / "runs"))


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_report_is_written_and_its_path_is_the_last_line(root):
    result = report(root)
    assert result.exit_code == 0, result.output
    page = Path(result.stdout.splitlines()[-1])
    assert page == (root / "runs" / NAME / "report" / "report.html").resolve()
    assert all(motion in page.read_text() for motion in FRAMES)
    numbers = json.loads((page.parent / "report.json").read_text())
    assert check_report(numbers) == []
    assert numbers["stages"]["report"]["seconds"] > 0
    assert numbers["machine"]["versions"]["numpy"] and numbers["machine"]["cpu"]


def test_a_second_report_replaces_the_first(root):
    report(root)
    folder = root / "runs" / NAME / "report"
    (folder / "figures" / "stale.svg").write_text("old")
    assert report(root).exit_code == 0
    assert not (folder / "figures" / "stale.svg").exists()


def crash_while_drawing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldsim.report.report.render_page", _raise)


def crash_while_writing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldsim.report.report.json.dumps", _raise)


def crash_while_replacing(monkeypatch: pytest.MonkeyPatch) -> None:
    replace = os.replace

    def failing(source: Path, target: Path) -> None:
        if str(source).endswith(".partial"):
            raise RuntimeError("the power went out")
        replace(source, target)

    monkeypatch.setattr("ldsim.artefacts.atomic.os.replace", failing)


def _raise(*_: object, **__: object) -> None:
    raise RuntimeError("the power went out")


@pytest.mark.parametrize("crash", [crash_while_drawing, crash_while_writing, crash_while_replacing])
def test_a_crash_leaves_the_previous_report_as_it_was(root, monkeypatch, crash):
    assert report(root).exit_code == 0
    folder = root / "runs" / NAME
    before = content(folder)
    crash(monkeypatch)
    result = report(root)
    assert isinstance(result.exception, RuntimeError)
    assert content(folder) == before


@pytest.mark.parametrize("crash", [crash_while_drawing, crash_while_writing, crash_while_replacing])
def test_a_crash_of_the_first_report_leaves_none(root, monkeypatch, crash):
    before = content(root / "runs" / NAME)
    crash(monkeypatch)
    report(root)
    assert content(root / "runs" / NAME) == before
    assert not (root / "runs" / NAME / "report").exists()


@pytest.mark.parametrize("kind", ["scene", "snapshots", "model"])
def test_what_is_of_another_run_is_one_line_and_exit_status_1(root, tmp_path, kind):
    """What else is refused of an artefact is in test_bad_input.py."""
    other = tmp_path / "other_run"
    other.mkdir()
    write_run(other, validation=False)
    shutil.copy(other / f"{kind}.h5", root / "runs" / NAME / f"{kind}.h5")
    result = report(root)
    assert result.exit_code == 1 and isinstance(result.exception, SystemExit)
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert "was made from another" in line
    assert not list((root / "runs").glob("*/report"))


def test_a_folder_that_cannot_be_written_is_one_line(root, monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ldsim.artefacts.atomic.Path.mkdir", full)
    result = report(root)
    assert result.exit_code == 1 and "No space left on device; free some space" in result.stderr
