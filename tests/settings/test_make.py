"""What makes a stage stale, and that the reduced step is compiled beside the stages that have none."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from ldsim.artefacts.store import Header
from ldsim.run import Run
from ldsim.settings import make, settings_of
from tests.artefacts.examples import EXAMPLES
from tests.settings.test_enrich import CONTENT


class Process:
    """A process that ends when it is waited for, and notes what happens to it."""

    def __init__(self, notes: list[str], command: list[str], **_: Any) -> None:
        assert command == [sys.executable, "-m", "ldsim.dynamics.reduced.ahead"]
        self._notes = notes
        notes.append("begun")

    def poll(self) -> int | None:
        return 0 if "waited" in self._notes else None

    def wait(self) -> None:
        self._notes.append("waited")

    def kill(self) -> None:
        self._notes.append("killed")


@pytest.fixture
def notes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """What happens, on a machine where nothing was compiled before."""
    found = list[str]()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(make.subprocess, "Popen", lambda *given, **more: Process(found, *given, **more))
    return found


def test_it_is_begun_once_and_waited_for_by_the_first_stage_that_takes_steps(notes: list[str]) -> None:
    with make.compiled_ahead(notes.append) as before:
        for stage in ("mesh", "snapshot", "pca", "train"):
            before(stage)
            notes.append(stage)
    said = "compiling the reduced step, once on this machine"
    assert notes == ["begun", "mesh", "snapshot", said, "waited", "pca", "waited", "train", "killed", "waited"]


def test_a_stage_that_fails_leaves_no_process_behind(notes: list[str]) -> None:
    with pytest.raises(make.StageFailed), make.compiled_ahead(notes.append) as before:
        before("mesh")
        raise make.StageFailed("mesh", 1)
    assert notes == ["begun", "killed", "waited"]


def test_it_is_not_begun_where_it_is_kept_from_before_or_where_no_stage_needs_it(
    notes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with make.compiled_ahead(notes.append) as before:
        before("train")
    monkeypatch.setattr(make, "are_kept", lambda path: path.name == "advance.py")
    with make.compiled_ahead(notes.append) as before:
        before("mesh")
    assert notes == []


def test_how_many_threads_share_out_the_poses_makes_no_cubature_stale(tmp_path: Path) -> None:
    def reasons(**cubature: object) -> dict[str, str]:
        settings = settings_of(CONTENT | {"cubature": cubature}, "a test")
        return make.Staleness(Run(tmp_path), settings, tmp_path).reasons("cubature")

    before = settings_of(CONTENT, "a test").cubature.dump()
    header = Header("cubature", before, {}, 0, {"experiment": "part"})
    EXAMPLES["cubature"].write(tmp_path / "cubature.h5", header)
    assert reasons() == reasons(threads=1) == {}
    assert reasons(threads=1, tolerance=0.5) == {"cubature": "tolerance changed"}
