"""Every command that a page tells its reader to type is one, with options that it has."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest

from ldsim.cli.app import COMMANDS, main

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "docs" / "index.md", *sorted((ROOT / "docs" / "guide").glob("*.md"))]
TYPED = re.compile(r"^    (?:\S+ && )*(?:\S*/)?ldsim ([^#\n]*)", re.M)
MADE = re.compile(r"^    make( [^#\n]*)?", re.M)


def parse(words: list[str]) -> None:
    """Read the words as the command line does, without running anything; raises where an option or a value is none."""
    name, *rest = words
    parent = main.make_context("ldsim", [name, "--help"])
    command = main.get_command(parent, name)
    assert command is not None
    command.make_context(name, rest, parent=parent)


def typed(pattern: re.Pattern[str], page: Path) -> list[list[str]]:
    """The words of each line, without what a shell adds; a usage with brackets is no command."""
    lines = [re.split(r"&&|\|\|", found[1] or "")[0] for found in pattern.finditer(page.read_text("utf-8"))]
    return [shlex.split(line) for line in lines if "[" not in line and "…" not in line]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_of_a_page_is_understood(page: Path) -> None:
    for words in typed(TYPED, page):
        assert words[0] in COMMANDS, f"{page.name}: ldsim {words[0]}"
        parse(words)


def test_every_goal_of_make_is_one() -> None:
    goals = set(re.findall(r"^([a-z]+)[a-z ]*:", (ROOT / "Makefile").read_text("utf-8"), re.M))
    goals |= {"mesh", "snapshot", "pca", "train", "cubature", "simulate", "report"}
    for page in PAGES:
        for words in typed(MADE, page):
            named = [word for word in words if "=" not in word]
            assert set(named) <= goals, f"{page.name}: make {' '.join(words)}"


def test_a_command_that_is_none_would_be_seen() -> None:
    assert [words[0] for words in typed(TYPED, PAGES[0])].count("play") >= 2
    with pytest.raises(click.UsageError):
        parse(["export", "runs/demo", "--frames", "3"])
