"""The files that a configuration names: found, or refused in one line."""

from __future__ import annotations

import os
from pathlib import Path, PureWindowsPath

import numpy as np
import pytest

from ldsim.errors import SettingsError
from ldsim.mesh.mesh import Mesh
from ldsim.pipeline import files
from ldsim.pipeline.files import file_sums, relative_path, resolve_path
from tests.mesh.painted import write_gltf
from tests.mesh.test_formats import POINTS, TET, write


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


@pytest.mark.parametrize("extension", [".xdmf", ".ele", ".gltf", ".vtk"])
def test_a_mesh_of_which_only_the_second_file_has_changed_is_another(tmp_path: Path, extension: str) -> None:
    """Numbers of .xdmf lie in an .h5, those of .ele in a .node, those of .gltf in its buffers."""

    def written(size: float) -> str:
        if extension == ".gltf":
            return write_gltf(tmp_path, np.zeros(3), np.full(3, size), binary=False).name
        write(tmp_path / f"part{extension}", Mesh(size * POINTS[:4], TET, "tet4"))
        return f"part{extension}"

    name = written(1.0)
    one = file_sums([name], tmp_path)
    assert file_sums([written(1.0)], tmp_path) == one
    assert file_sums([written(2.0)], tmp_path) != one


def test_a_name_that_only_looks_like_the_variable_is_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LDSIM_DATA", str(tmp_path / "data"))
    for folder in ("LDSIM_DATA", "$LDSIM_DATA_OLD", "data"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.mesh").touch()
        assert resolve_path(f"{folder}/a.mesh", tmp_path) == tmp_path / folder / "a.mesh"
    for text in ("$LDSIM_DATA/a.mesh", "${LDSIM_DATA}/a.mesh"):
        assert resolve_path(text, tmp_path) == (tmp_path / "data" / "a.mesh").resolve()


def test_a_second_file_with_a_name_that_is_too_long_is_none(tmp_path: Path) -> None:
    """Whoever reads the mesh says so."""
    (tmp_path / "part.gltf").write_text('{"buffers": [{"uri": "%s.bin"}]}' % (300 * "a"))
    assert "part.gltf" in file_sums(["part.gltf"], tmp_path)


def test_a_path_from_a_folder_that_is_a_link_leads_to_the_file(tmp_path: Path) -> None:
    """And the file, which may be one too, keeps its name, for that tells what it is."""
    stored, link, file = tmp_path / "store" / "a1b2", tmp_path / "link", tmp_path / "parts" / "a part.stl"
    for folder in (stored.parent, file.parent, tmp_path / "far" / "away"):
        folder.mkdir(parents=True)
    stored.touch()
    file.symlink_to(stored)
    link.symlink_to(tmp_path / "far" / "away")
    found = relative_path(file, link)
    assert found == "../../parts/a part.stl"
    assert resolve_path(found, link).samefile(stored)


@pytest.mark.parametrize(
    ("way", "expected"), [("..\\parts\\a.stl", "../parts/a.stl"), (None, "D:/parts/a.stl")], ids=["near", "drive"]
)
def test_a_path_is_alike_on_every_system(way: str | None, expected: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """On Windows it would have backslashes, and there is none from one drive to another."""

    class WindowsPath(PureWindowsPath):
        def resolve(self) -> WindowsPath:
            return self

    def relpath(path: object, folder: object) -> str:
        if way is None:
            raise ValueError("path is on mount 'D:', start on mount 'C:'")
        return way

    monkeypatch.setattr(files, "Path", WindowsPath)
    monkeypatch.setattr(files.os.path, "relpath", relpath)
    assert relative_path(WindowsPath("D:\\parts\\a.stl"), WindowsPath("C:\\configs")) == expected  # type: ignore[arg-type]
