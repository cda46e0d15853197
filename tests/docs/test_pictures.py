"""The pictures of README and the guide are there, small, described, and of what they show as it is now."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from reproduction.harness import MADE
from reproduction.pages import input_hashes
from reproduction.pictures import LARGEST

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHOWN = re.compile(r"!\[([^\]]*)\]\(([^)\s]+)\)")
# What `make pictures` does not make.
OWN = {"two_commands.webp": "python -m reproduction.bench.two_commands --folder FOLDER --film"}
MADE_FROM = json.loads(MADE.read_text("utf-8"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_picture_of_a_page_is_made_from_what_is_there_now(page: Path) -> None:
    for words, target in SHOWN.findall(page.read_text("utf-8")):
        file = (page.parent / target).resolve()
        assert file.is_file() and words.strip(), f"{page.name} shows {target}"
        assert file.stat().st_size < LARGEST
        shows = MADE_FROM[file.name]
        assert input_hashes(shows) == shows, (
            f"{target} shows what has changed since: run `{OWN.get(file.name, 'make pictures')}` and commit"
        )


def test_the_live_page_is_of_the_demo_as_it_is_now() -> None:
    """Its library, script and style are those of today by docs/generate.py (test_docs.py)."""
    shows = MADE_FROM["demo.html"]
    assert input_hashes(shows) == shows, "docs/live/demo.html shows what has changed since: run `make pictures`"


def test_no_picture_is_kept_that_nothing_shows() -> None:
    texts = "".join(page.read_text("utf-8") for page in PAGES)
    kept = [file.name for kind in ("*.webp", "*.png", "*.svg") for file in MADE.parent.glob(kind)]
    assert not [name for name in kept if name not in texts]
