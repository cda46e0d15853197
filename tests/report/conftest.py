"""The small run, sound and with a space that is lost; tests only read them."""

from __future__ import annotations

from pathlib import Path

import pytest

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
