"""Compiled kernels are kept apart by the content of every source file that they may call."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ldsim.jit import KEPT_DAYS, forget_unused, source_state


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package in which a imports inner.b, and c is for itself."""
    folder = tmp_path / "ldsim"
    (folder / "inner").mkdir(parents=True)
    (folder / "a.py").write_text("from ldsim.inner.b import y\n")
    (folder / "inner" / "b.py").write_text("y = 1\n")
    (folder / "c.py").write_text("z = 1\n")
    return folder


def state(package: Path) -> str:
    """Of the file a, with nothing remembered."""
    source_state.cache_clear()
    return source_state(package / "a.py", package)


def test_the_state_is_the_same_while_nothing_changes(package: Path) -> None:
    assert state(package) == state(package)


def test_the_state_does_not_depend_on_where_the_package_lies(package: Path, tmp_path: Path) -> None:
    before = state(package)
    (tmp_path / "elsewhere").mkdir()
    assert state(package.rename(tmp_path / "elsewhere" / "ldsim")) == before


@pytest.mark.parametrize("imported", ["from ldsim.inner.b import y", "from ldsim.inner import b"])
def test_a_change_of_an_imported_file_changes_the_state(package: Path, imported: str) -> None:
    (package / "inner" / "__init__.py").write_text("")
    (package / "a.py").write_text(f"{imported}\n")
    before = state(package)
    (package / "inner" / "b.py").write_text("y = 22\n")
    assert state(package) != before


def test_a_change_of_a_file_that_is_not_imported_does_not(package: Path) -> None:
    before = state(package)
    (package / "c.py").write_text("z = 22\n")
    assert state(package) == before


@pytest.mark.parametrize(
    "variable, file", [("XDG_CACHE_HOME", "ldsim/kernels/tensors-*/*.nbi"), ("NUMBA_CACHE_DIR", "*/*.nbi")]
)
def test_kernels_are_kept_where_the_environment_says(tmp_path: Path, variable: str, file: str) -> None:
    code = "import numpy as np\nfrom ldsim.mechanics.materials.tensors import determinant\ndeterminant((1.0,) * 9)\n"
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment | {variable: str(tmp_path)})
    assert list(tmp_path.glob(file))


def test_only_folders_that_nobody_used_are_forgotten(tmp_path: Path) -> None:
    for name, days in (("old", KEPT_DAYS + 1), ("new", KEPT_DAYS - 1)):
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (time.time() - days * 24 * 3600,) * 2)
    forget_unused(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["new"]


def test_kernels_that_check_their_indices_are_kept_apart_and_do_check(tmp_path: Path) -> None:
    """A kernel without bounds reads what lies beside an array; the same one with bounds says so."""
    program = (
        "import numpy as np\nfrom ldsim.jit import copy\n"
        "try:\n    copy(np.zeros(2), np.zeros(3))\nexcept IndexError as error:\n    print('refused')\n"
    )
    said = []
    for bounds in ("0", "1", "0", "1"):
        environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "NUMBA_BOUNDSCHECK": bounds}
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        said.append(done.stdout.strip())
    assert said == ["", "refused", "", "refused"]
    folders = [path.name for path in (tmp_path / "ldsim" / "kernels").glob("jit-*")]
    assert len(folders) == 2 and sum(name.endswith("-checked") for name in folders) == 1
