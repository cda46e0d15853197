"""What every test finds: nothing of the caller's environment, and one thread a process; and who runs which tests.

Who runs the tests may have set whatever make, numba, matplotlib or ldsim itself listen to, and make sets some for the
programs that it starts. So before anything else is imported, only what is listed here is left, for the processes too
that the tests start.
"""

import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from xdist.scheduler import LoadScopeScheduling

NEEDED = ("PATH", "LD_LIBRARY_PATH", "HOME", "TMPDIR", "XDG_CACHE_HOME", "CUDA_VISIBLE_DEVICES", "NUMBA_BOUNDSCHECK")
OF_PYTEST = ("PYTEST_", "COV_")
# Several pools of threads on few cores wait for each other. Messages are compared in English and in one encoding.
GIVEN = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "LC_ALL": "C.UTF-8"}

for variable in set(os.environ) - set(NEEDED):
    if not variable.startswith(OF_PYTEST):
        del os.environ[variable]
os.environ.update(GIVEN)

# What takes longest comes first, so that no process is left with it at the end.
SLOW = ("tests/cli/", "tests/pipeline/test_ensemble.py", "tests/learn/", "tests/test_make.py", "tests/report/")


def unit(test: str) -> str:
    """The tests that one process runs together: those of a file, and all of the commands, which share a finished run.

    That run compiles nearly every kernel, a minute's work; meanwhile the other processes do what needs few of them.
    """
    return "tests/cli" if test.startswith("tests/cli/") else test.split("::")[0]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    places = {folder: place for place, folder in enumerate(SLOW)}
    items.sort(key=lambda item: min((places[slow] for slow in SLOW if item.nodeid.startswith(slow)), default=len(SLOW)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadScopeScheduling | None:
    return Units(config, log) if config.getvalue("dist") == "load" else None


class Units(LoadScopeScheduling):
    """Hands each process the next unit, in the order of collection."""

    def __init__(self, config: pytest.Config, log: Any) -> None:
        config.option.loadscopereorder = False
        super().__init__(config, log)

    def _split_scope(self, nodeid: str) -> str:
        return unit(nodeid)


@pytest.fixture(scope="session")
def playable(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a small beam that can be simulated; tests only read it."""
    from tests.simulator.playable import write_playable  # not before the environment is as it should be

    folder: Path = tmp_path_factory.mktemp("playable")
    write_playable(folder)
    return folder


@pytest.fixture
def own_run(playable: Path, tmp_path: Path) -> Path:
    """A copy of it for one test alone."""
    return Path(shutil.copytree(playable, tmp_path, dirs_exist_ok=True))
