"""The example that is a notebook: its cells run, and leave the solid where the exported model in C is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ldsim.mechanics.scene import Scene
from ldsim.runtime.library import NativeModel
from tests.examples.conftest import EXAMPLES, farthest, pulled

CELLS = json.loads((EXAMPLES / "jupyter" / "pull.ipynb").read_text("utf-8"))["cells"]
CODE = [cell for cell in CELLS if cell["cell_type"] == "code"]


def test_the_notebook_is_kept_without_what_it_printed() -> None:
    assert len(CODE) >= 3
    assert not any(cell["outputs"] or cell["execution_count"] for cell in CODE)


def test_the_cells_of_the_notebook_pull_as_the_exported_model_does(
    root: Path, model: NativeModel, scene: Scene, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(root / "examples" / "jupyter")
    names: dict[str, Any] = {}
    *cells, last = ("".join(cell["source"]) for cell in CODE)
    for cell in cells:
        exec(compile(cell, "pull.ipynb", "exec"), names)
    shown = eval(last, names)._repr_html_()  # a notebook shows what the last line of a cell is
    position, force = pulled(model, scene)
    assert names["far"] == farthest(scene)
    np.testing.assert_allclose(names["hangs"], position, rtol=0, atol=1e-6)
    np.testing.assert_allclose(names["pull"].force, force, rtol=1e-5, atol=1e-6)
    assert f"vertex {farthest(scene)} hangs at" in capsys.readouterr().out
    assert shown.startswith("<iframe srcdoc=") and "ldsim_step" in shown
