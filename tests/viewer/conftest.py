"""A run of a small beam to play with."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.simulator.playable import write_playable


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    write_playable(folder, resolution=1)
    return folder
