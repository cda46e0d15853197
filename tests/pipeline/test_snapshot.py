"""The first two stages: what their artefacts say that they were made from, and what makes them anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ldsim.artefacts.sealed_file import UnreadableError
from ldsim.artefacts.store import file_hash
from ldsim.pipeline import mesh as meshing
from ldsim.pipeline import snapshot as stage
from ldsim.pipeline.files import file_sums
from ldsim.pipeline.mesh import mesh
from ldsim.pipeline.snapshot import snapshot
from ldsim.run import Run
from tests.helpers import changed
from tests.pipeline.two_tets import MESH, RECORDING, SCENE, made, motions, run_here


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setattr(stage, "run_motions", run_here)
    return made(tmp_path)


def test_a_scene_says_of_what_file_it_was_made_though_that_is_replaced_meanwhile(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, describe = file_sums([MESH], tmp_path), meshing.described_scene

    def and_replace(*given: Any, **named: Any) -> Any:
        found = describe(*given, **named)
        (tmp_path / MESH).write_text((tmp_path / MESH).read_text("utf-8") + "\n", encoding="utf-8")
        return found

    monkeypatch.setattr(meshing, "described_scene", and_replace)
    mesh(run, SCENE, base=tmp_path)
    assert run.header("scene").notes["files"] == before != file_sums([MESH], tmp_path)


def test_snapshots_say_of_what_they_were_made_though_it_is_replaced_while_they_run(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that what was replaced makes them stale."""
    files, scene = file_sums([RECORDING], tmp_path), file_hash(run.path("scene"))

    def and_replace(*given: Any) -> None:
        run_here(*given)
        with (tmp_path / RECORDING).open("a", encoding="utf-8") as recording:
            recording.write("0,0,0,0,0,0,0\n")
        with changed(run.path("scene")) as file:
            file.attrs["seconds"] = 1e3

    monkeypatch.setattr(stage, "run_motions", and_replace)
    with snapshot(run, motions(), base=tmp_path) as found:
        assert found.header.inputs == {"scene": scene} and scene != file_hash(run.path("scene"))
        assert found.header.notes["files"] == files != file_sums([RECORDING], tmp_path)


def test_more_workers_make_no_other_snapshots(run: Run, tmp_path: Path) -> None:
    snapshot(run, motions(workers=1), base=tmp_path).close()
    before = run.path("snapshots").read_bytes()
    snapshot(run, motions(workers=3), base=tmp_path).close()
    assert run.path("snapshots").read_bytes() == before
    assert motions(workers=3).learned.dump() == motions().learned.dump(), "what `ldsim make` compares"


def test_snapshots_that_may_not_be_read_are_not_made_anew(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    snapshot(run, motions(), base=tmp_path).close()
    before = run.path("snapshots").read_bytes()

    def refused(*_: Any) -> None:
        raise UnreadableError("snapshots.h5 cannot be read: Permission denied")

    monkeypatch.setattr(stage, "Snapshots", refused)
    with pytest.raises(UnreadableError):
        snapshot(run, motions(), base=tmp_path)
    assert run.path("snapshots").read_bytes() == before
