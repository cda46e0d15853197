"""The examples of docs/guide/batched.md, run on a small solid in place of the demo, which alone has the number."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.report.small_run import write_run

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "batched.md"


def test_the_examples_of_the_page_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_run(tmp_path / "runs" / "demo")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)
    assert len(blocks) == 3
    names: dict[str, object] = {}
    exec(compile("\n".join(blocks), str(PAGE), "exec"), names)
    assert tuple(names["u"].shape) == (16, 8, 3)
    assert re.fullmatch(r"recovered \d\.\d{3} of the modulus\n", capsys.readouterr().out)
