"""The bundles that are committed are those of the sources beside them."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

import ldsim.web

WEB = Path(ldsim.web.__file__).parent


@pytest.mark.parametrize("name", ["playground", "report"])
def test_a_bundle_is_made_of_the_sources_as_they_are(name: str) -> None:
    files = sorted((file for file in (WEB / "src").rglob("*") if file.is_file()), key=lambda file: file.as_posix())
    sources = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    first = ldsim.web.bundle(name).split("\n", 1)[0]
    assert first.endswith(f"sources {sources}"), "run ldsim/web/build.sh and commit its bundles"
