"""The first two stages: what their artefacts say that they were made from, and what makes them anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ldsim.artefacts.partial import write_snapshots
from ldsim.artefacts.sealed_file import UnreadableError
from ldsim.artefacts.store import file_hash
from ldsim.errors import ArtefactError
from ldsim.pipeline import mesh as meshing
from ldsim.pipeline import snapshot as stage
from ldsim.pipeline.files import file_sums
from ldsim.pipeline.mesh import mesh
from ldsim.pipeline.options import SnapshotOptions
from ldsim.pipeline.progress import Progress
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


@pytest.mark.parametrize(("before", "after"), [("train", "test"), ("test", "train")])
def test_a_motion_that_changes_its_role_is_kept_though_the_second_file_cannot_be_written(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: str, after: str
) -> None:
    def options(role: str) -> SnapshotOptions:
        one, other = ({"name": name, "recording": RECORDING} for name in ("a", "b"))
        return motions(motions=[one, other | {"role": role}])

    snapshot(run, options(before), base=tmp_path)
    written = list[Path]()

    def only_the_first(path: Path, *given: Any) -> None:
        if written:
            raise ArtefactError("no space left")
        written.append(path)
        write_snapshots(path, *given)

    monkeypatch.setattr(stage, "write_snapshots", only_the_first)
    with pytest.raises(ArtefactError, match="no space left"):
        snapshot(run, options(after), base=tmp_path)
    monkeypatch.setattr(stage, "write_snapshots", write_snapshots)
    monkeypatch.setattr(stage, "run_motions", lambda *_: pytest.fail("a motion ran anew"))
    with snapshot(run, options(after), base=tmp_path) as found:
        assert found.names == ["a", "b"] and found.with_role(after)[-1:] == ["b"]
    run.close()


class Told(Progress):
    """Notes that are kept."""

    def __init__(self) -> None:
        self.lines = list[str]()

    def tell(self, text: str) -> None:
        self.lines.append(text)


def test_that_damaged_snapshots_are_made_anew_is_told(run: Run, tmp_path: Path) -> None:
    first, again = Told(), Told()
    snapshot(run, motions(), first, base=tmp_path).close()
    run.path("snapshots").write_bytes(b"damaged")
    run.written("snapshots")
    snapshot(run, motions(), again, base=tmp_path).close()
    notes = [[line for line in told.lines if line.startswith("note: ")] for told in (first, again)]
    assert notes[0] == [] and len(notes[1]) == 1
    assert "snapshots.h5 is not a readable HDF5 file" in notes[1][0] and "its motions run anew" in notes[1][0]
