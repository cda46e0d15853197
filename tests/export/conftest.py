"""A small finished run to export, written once a session, and what other programs are found by."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ldsim.run import Run
from tests.report.small_run import write_run


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tiny")
    write_run(folder)
    return folder


@pytest.fixture
def run(run_folder: Path) -> Iterator[Run]:
    with Run.open(run_folder) as found:
        yield found
