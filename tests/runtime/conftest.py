"""The C library, built once a session by the compiler of the machine."""

from __future__ import annotations

from pathlib import Path

import pytest

from ldsim.runtime.compilers import compiler
from ldsim.runtime.library import Library, build


@pytest.fixture(scope="session")
def cc() -> str:
    """The C compiler. `.ci/run` fails where a test was skipped for want of it."""
    command = compiler()
    if command is None:
        pytest.skip("no C compiler (cc, gcc or clang) is installed: it builds the library")
    return command


@pytest.fixture(scope="session")
def library(cc: str, tmp_path_factory: pytest.TempPathFactory) -> Library:
    return Library(build(tmp_path_factory.mktemp("library"), ("-O2", "-Wall", "-Wextra", "-Werror")))


@pytest.fixture(scope="session")
def sources() -> Path:
    import ldsim.runtime

    return Path(ldsim.runtime.__file__).parent
