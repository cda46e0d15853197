"""What a killed process leaves behind goes with the next that writes the same."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from ldsim.artefacts import atomic
from ldsim.artefacts.atomic import replacing, replacing_folder
from tests.artefacts.examples import EXAMPLES
from tests.artefacts.test_artefacts import header
from tests.cli.experiments import invoked
from tests.helpers import changed

DEAD = 2**22 + 1


@pytest.mark.parametrize("kind", ["old", "partial"])
def test_a_kill_during_a_report_leaves_nothing_for_ever(kind: str, tmp_path: Path) -> None:
    leftover = tmp_path / f".report.{atomic.HOST}-{DEAD}.{kind}"
    living = tmp_path / f".report.{atomic.HOST}-{os.getppid()}.{kind}"
    for folder in (leftover, living):
        folder.mkdir()
        (folder / "report.json").write_text("{}")
    with replacing_folder(tmp_path / "report") as made:
        (made / "report.json").write_text("{}")
    assert not leftover.exists() and living.exists()
    assert (tmp_path / "report" / "report.json").exists()


@pytest.mark.parametrize(
    ("writer", "knows"),
    [(f"elsewhere-{DEAD}", True), (f"{atomic.HOST}-{DEAD}", False), (str(DEAD), True)],
    ids=["of another machine", "where processes are not known", "of an earlier version"],
)
def test_what_may_be_written_still_stays_until_it_has_not_changed_for_a_day(
    writer: str, knows: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(atomic, "KNOWS_PROCESSES", knows)
    file, folder = (tmp_path / f".{name}.{writer}.partial" for name in ("a.h5", "report"))

    def write_both() -> None:
        with replacing(tmp_path / "a.h5") as made:
            made.touch()
        with replacing_folder(tmp_path / "report"):
            pass

    file.touch()
    folder.mkdir()
    write_both()
    assert file.exists() and folder.exists()
    yesterday = time.time() - 25 * 3600
    for each in (file, folder):
        os.utime(each, (yesterday, yesterday))
    write_both()
    assert not file.exists() and not folder.exists()


def test_a_writer_of_this_machine_that_lives_may_take_days(tmp_path: Path) -> None:
    living = tmp_path / f".a.h5.{atomic.HOST}-{os.getppid()}.partial"
    living.touch()
    os.utime(living, (0.0, 0.0))
    with replacing(tmp_path / "a.h5") as made:
        made.touch()
    assert living.exists()


def test_names_that_only_look_like_those_of_writers_stay(tmp_path: Path) -> None:
    for name in (".a.h5.backup.old", ".a.h5.notes", ".b.h5.1.partial"):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (0.0, 0.0))
    with replacing(tmp_path / "a.h5") as made:
        made.touch()
    assert len(list(tmp_path.iterdir())) == 4


def test_info_prints_nothing_that_a_terminal_obeys(tmp_path: Path) -> None:
    path = tmp_path / "scene.h5"
    EXAMPLES["scene"].write(path, header("scene"))
    with changed(path) as file:
        file.attrs["settings"] = "a: \x1b]0;owned\x07 \u202e\n"
    said = invoked("info", str(path))
    assert said.exit_code == 0
    assert "owned" in said.stdout
    assert all(letter.isprintable() or letter == "\n" for letter in said.stdout)
