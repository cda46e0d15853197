"""What a killed process leaves behind goes with the next that writes the same."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from ldsim.artefacts.atomic import replacing_folder
from ldsim.cli.app import main
from tests.artefacts.examples import EXAMPLES
from tests.artefacts.test_artefacts import header
from tests.helpers import changed

DEAD = 2**22 + 1


@pytest.mark.parametrize("kind", ["old", "partial"])
def test_a_kill_during_a_report_leaves_nothing_for_ever(kind: str, tmp_path: Path) -> None:
    leftover = tmp_path / f".report.{DEAD}.{kind}"
    living = tmp_path / f".report.{os.getppid()}.{kind}"
    for folder in (leftover, living):
        folder.mkdir()
        (folder / "report.json").write_text("{}")
    with replacing_folder(tmp_path / "report") as made:
        (made / "report.json").write_text("{}")
    assert not leftover.exists() and living.exists()
    assert (tmp_path / "report" / "report.json").exists()


def test_info_prints_nothing_that_a_terminal_obeys(tmp_path: Path) -> None:
    path = tmp_path / "scene.h5"
    EXAMPLES["scene"].write(path, header("scene"))
    with changed(path) as file:
        file.attrs["settings"] = "a: \x1b]0;owned\x07 \u202e\n"
    said = CliRunner().invoke(main, ["info", str(path)])
    assert said.exit_code == 0
    assert "owned" in said.stdout
    assert all(letter.isprintable() or letter == "\n" for letter in said.stdout)
