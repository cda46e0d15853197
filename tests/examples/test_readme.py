"""The table of the examples says what the examples say."""

from __future__ import annotations

import re

import pytest

from tests.examples.conftest import EXAMPLES

ROWS = [row for row in (EXAMPLES / "README.md").read_text("utf-8").splitlines() if row.startswith("| [")]


def commands(text: str) -> list[str]:
    return re.findall(r"^(?://)? {5}(\S.+)$", text, re.M)


@pytest.mark.parametrize("example", ["cpp/main.cpp", "csharp/Program.cs", "threejs/index.html"])
def test_the_commands_of_the_table_are_those_of_the_first_comment(example: str) -> None:
    (row,) = (row for row in ROWS if f"({example})" in row)
    told = re.findall(r"`([^`]+)`", row.split(" | ")[2])
    own = commands((EXAMPLES / example).read_text("utf-8").split("#include")[0].split("\nusing")[0].split("-->")[0])
    assert len(own) >= 5 and told == own


def test_the_table_lists_every_folder() -> None:
    folders = {path.name for path in EXAMPLES.iterdir() if path.is_dir()}
    listed = {re.match(r"\| \[(\w+)\]", row).group(1) for row in ROWS}  # type: ignore[union-attr]
    assert folders == listed - {"c", "node"}  # which are exported with the model
