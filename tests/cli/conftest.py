"""The finished experiment, run once a session, and a copy of it for each test to break."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from ldsim.cli.cubature import MISSED
from tests.cli.experiments import COMMANDS, TINY, Experiment


@pytest.fixture(scope="session")
def finished_experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    experiment = Experiment(tmp_path_factory.mktemp("finished"))
    experiment.configure(TINY)
    for command in COMMANDS:
        result = experiment.invoke(command)
        # of a few poses some rule may miss its tolerance, which costs nothing
        assert result.exit_code in ((0, MISSED) if command == "cubature" else (0,)), result.output
    return experiment


@pytest.fixture
def experiment(finished_experiment: Experiment, tmp_path: Path) -> Experiment:
    shutil.copytree(finished_experiment.folder, tmp_path, dirs_exist_ok=True)
    return Experiment(tmp_path)
