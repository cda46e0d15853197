"""The Python examples of the pages run as they stand, one page after the other block by block."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.simulator.playable import write_playable

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "simulator.md"


def test_the_examples_of_the_simulator_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "runs" / "demo").mkdir(parents=True)
    write_playable(tmp_path / "runs" / "demo", resolution=1)
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)
    assert len(blocks) >= 5
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    first, second = names["ends"]  # type: ignore[misc]
    assert abs(first - second).max() > 1e-5  # type: ignore[has-type]
