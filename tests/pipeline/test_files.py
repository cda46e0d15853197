"""The files that a configuration names: found, or refused in one line."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ldsim.errors import SettingsError
from ldsim.pipeline.files import resolve_path


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.vtk", "none.vtk does not exist"),
        ("folder", "is no file"),
        ("~nobody-of-this-name/part.vtk", "~nobody-of-this-name/part.vtk .* no home folder"),
        (300 * "a" + ".vtk", "a.vtk cannot be read: File name too long"),
    ],
    ids=["missing", "folder", "home of nobody", "long name"],
)
def test_a_name_of_no_file_is_refused_in_one_line(tmp_path: Path, name: str, words: str) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(SettingsError, match=words) as error:
        resolve_path(name, tmp_path)
    assert "\n" not in str(error.value)


def test_a_file_that_may_not_be_read_is_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever runs the tests may read everything, perhaps."""
    path = tmp_path / "part.vtk"
    path.touch()
    monkeypatch.setattr(os, "access", lambda place, mode: place != path or mode != os.R_OK)
    with pytest.raises(SettingsError, match=r"part\.vtk may not be read by you") as error:
        resolve_path("part.vtk", tmp_path)
    assert "\n" not in str(error.value)
