"""The small run, sound and with a space that is lost: their files, which tests only read, and each opened anew."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ldsim.run import Run
from tests.report.small_run import write_run


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run")
    write_run(path)
    return path


@pytest.fixture(scope="session")
def lost_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lost")
    write_run(path, lost=("linear", "push"))
    return path


@pytest.fixture
def run(folder: Path) -> Iterator[Run]:
    with Run.open(folder) as found:
        yield found


@pytest.fixture
def lost(lost_folder: Path) -> Iterator[Run]:
    with Run.open(lost_folder) as found:
        yield found
