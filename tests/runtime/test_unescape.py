"""A functional mock-up unit finds its files wherever they lie: paths in URIs, of which sanitizers watch every byte."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.runtime import fuzz

PATHS = {
    "file:///tmp/a%20b": "/tmp/a b",
    "file:///tmp/%C3%a9": "/tmp/é",
    "file:///tmp/100%2": "/tmp/100%2",
    "file:///tmp/100%": "/tmp/100%",
    "file:///tmp/50% dec": "/tmp/50% dec",
    "file:///tmp/%+1%-1%0x": "/tmp/%+1%-1%0x",
    "file:///tmp/%%41%4": "/tmp/%A%4",
    "file:/tmp/a%20b": "/tmp/a b",
    "file://localhost/tmp/a%20b": "/tmp/a b",
    "file:////host/share": "//host/share",
    "/tmp/a": "/tmp/a",
    "": "",
}


@pytest.fixture(scope="module")
def program(cc: str, sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("unescape") / "unescape"
    files = [str(Path(__file__).with_name("unescape.c")), str(sources / "ldsim.c")]
    command = [cc, *fuzz.FLAGS, f"-I{sources}", *files, "-o", str(made), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        assert "sanitize" in done.stderr, done.stderr
        pytest.skip("the C compiler has no sanitizers")
    return made


@pytest.mark.parametrize("uri", PATHS)
def test_a_path_is_found_without_its_host_and_only_a_percent_sign_before_two_digits_is_an_escape(
    program: Path, uri: str
) -> None:
    done = subprocess.run([program, uri], capture_output=True)
    assert done.returncode == 0, done.stderr.decode()[:4000]
    assert done.stdout.decode() == f"{PATHS[uri]}\n"
