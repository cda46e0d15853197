"""The folder of compiled kernels changes with any source file that a kernel may call."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ldsim.compiled import KEPT, LATELY_S, forget_oldest, source_state


@pytest.fixture
def package(tmp_path: Path) -> Path:
    (tmp_path / "inner").mkdir()
    (tmp_path / "a.py").write_text("x = 1\n")
    (tmp_path / "inner" / "b.py").write_text("y = 1\n")
    return tmp_path


def test_the_state_is_the_same_while_nothing_changes(package: Path) -> None:
    assert source_state([package]) == source_state([package])


def test_a_change_in_any_file_changes_the_state(package: Path) -> None:
    before = source_state([package])
    (package / "inner" / "b.py").write_text("y = 22\n")
    assert source_state([package]) != before


def test_numba_is_pointed_to_that_folder_unless_told_otherwise(tmp_path: Path) -> None:
    code = "import ldsim, os; print(os.environ['NUMBA_CACHE_DIR'])"
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    for extra, expected in (({"XDG_CACHE_HOME": str(tmp_path)}, str(tmp_path)), ({"NUMBA_CACHE_DIR": "/x"}, "/x")):
        command = [sys.executable, "-c", code]
        run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment | extra)
        assert run.stdout.startswith(expected)


def test_numba_is_pointed_there_even_if_it_was_imported_first(tmp_path: Path) -> None:
    code = "import numba, ldsim; print(numba.config.CACHE_DIR)"
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    command = [sys.executable, "-c", code]
    environment["XDG_CACHE_HOME"] = str(tmp_path)
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert run.stdout.startswith(str(tmp_path))


def test_only_folders_that_are_old_and_many_are_forgotten(tmp_path: Path) -> None:
    now = time.time()
    for i in range(KEPT + 4):
        (tmp_path / str(i)).mkdir()
        age = LATELY_S * (2 if i < 3 else 0.5)
        os.utime(tmp_path / str(i), (now - age, now - age))
    forget_oldest(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {str(i) for i in range(3, KEPT + 4)}
