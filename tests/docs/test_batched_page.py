"""The example of docs/batched.md: run on a small solid in place of the demo, it recovers the modulus."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.evaluation.small_run import write_run

PAGE = Path(__file__).parents[2] / "docs" / "batched.md"


def test_the_example_of_the_page_recovers_the_modulus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_run(tmp_path / "runs" / "demo")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)
    assert len(blocks) == 2
    exec(compile("\n".join(blocks), str(PAGE), "exec"), {})
    assert "recovered 0.600 of the modulus" in capsys.readouterr().out
