"""Every module of reproduction/ fits the package, and every benchmark says how it is called."""

from __future__ import annotations

import importlib
import json
import pkgutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import reproduction
from reproduction import harness
from reproduction.bench.novelty import area
from reproduction.bench.repeat import difference
from reproduction.harness import add_results, called, row, write_json, write_results

MODULES = [found.name for found in pkgutil.walk_packages(reproduction.__path__, "reproduction.")]
BENCHES = (
    "batched blocks browser condensed derived enrichment examples frontier full_space fuzz hand newcomer novelty pca "
    "repeat rival_spaces runtime soak solids statement time_steps two_commands"
).split()


@pytest.mark.parametrize("name", MODULES)
def test_every_module_imports(name: str) -> None:
    assert importlib.import_module(name).__doc__


def test_every_module_with_a_command_is_listed_here() -> None:
    modules = {name for name in MODULES if hasattr(importlib.import_module(name), "main")}
    assert modules == {f"reproduction.bench.{name}" for name in BENCHES} | {
        "reproduction.faults.campaign",
        "reproduction.pictures",
    }


@pytest.mark.parametrize("name", BENCHES)
def test_a_benchmark_says_by_what_name_it_is_called(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = importlib.import_module(f"reproduction.bench.{name}")
    monkeypatch.setattr(sys, "argv", [f"{name}.py", "--help"])
    with pytest.raises(SystemExit) as left:
        module.main()
    assert left.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: python -m {module.__name__} ")
    assert module.NAME == name


def test_results_say_where_they_come_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(harness, "RESULTS", tmp_path)
    monkeypatch.setattr(sys, "argv", ["soak.py", f"{tmp_path}/x", "--quick"])
    write_results("some", called("soak"), [row("x", "a number", 1.5, "s", "<= 2"), row("x", "lost", float("nan"))])
    content = json.loads((tmp_path / "some.json").read_text("utf-8"))
    assert {"machine", "versions", "command", "commit", "created", "inputs", "rows"} == set(content)
    assert content["command"] == "python -m reproduction.bench.soak runs/x --quick"
    monkeypatch.setattr(sys, "argv", ["frontier.py", str(harness.CONFIGS / "demo.yaml")])
    assert called("frontier") == "python -m reproduction.bench.frontier configs/demo.yaml"
    assert content["rows"][0] == {"model": "x", "quantity": "a number", "value": 1.5, "unit": "s", "goal": "<= 2"}
    assert content["rows"][1]["value"] is None


@pytest.mark.parametrize(
    ("score", "expected"), [([1, 2, 3, 4], 1.0), ([4, 3, 2, 1], 0.0), ([1, 3, 2, 4], 0.75), ([5, 5, 5, 5], 0.5)]
)
def test_the_area_under_a_roc_curve_is_how_often_bad_frames_score_higher(score: list[int], expected: float) -> None:
    assert area(np.array(score), np.array([False, False, True, True])) == expected


def test_rows_of_other_models_stay_and_tell_of_what_code_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(harness, "RESULTS", tmp_path)
    code = ["ldsim/space"]

    def written(command: str, *errors: tuple[str, float]) -> dict[str, Any]:
        path = add_results("a", command, [row(model, "error", error) for model, error in errors], code)
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return found

    first = written("first", ("x", 0.1), ("beam", 0.2))
    again = written("again", ("x", 0.3))
    assert again["rows"] == [row("x", "error", 0.3), row("beam", "error", 0.2)]
    assert {model: each["command"] for model, each in again["earlier"].items()} == {"beam": "first"}
    assert "earlier" not in written("again", ("beam", 0.2))  # all are of one code and command
    write_json(tmp_path / "a.json", first | {"inputs": {"ldsim/space": "0" * 64}})
    other = written("other", ("x", 0.4))
    assert {model: each["command"] for model, each in other["earlier"].items()} == {"beam": "first"}
    assert other["earlier"]["beam"]["inputs"] == {"ldsim/space": "0" * 64} != other["inputs"]
    assert written("other", ("dragon", 0.5))["earlier"] == other["earlier"]
    last = written("other", ("beam", 0.6))
    assert "earlier" not in last and harness.rows_before("a", "dragon") == [row("dragon", "error", 0.5)]


def test_results_that_were_written_before_do_not_make_a_commit_dirty(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def git(*words: str) -> None:
        who = ("-c", "user.name=a", "-c", "user.email=a@b.c")
        subprocess.run(["git", *who, *words], cwd=tmp_path, check=True, capture_output=True)

    monkeypatch.setattr(harness, "ROOT", tmp_path)
    code, result = tmp_path / "code.py", tmp_path / "reproduction" / "results" / "a.json"
    result.parent.mkdir(parents=True)
    for path in (code, result):
        path.write_text("0", encoding="utf-8")
    git("init", "-q")
    git("add", ".")
    git("commit", "-qm", "first")
    clean = harness.checked_out()
    result.write_text("1", encoding="utf-8")
    assert clean is not None and harness.checked_out() == clean
    code.write_text("1", encoding="utf-8")
    assert harness.checked_out() == f"{clean}-dirty"


def test_artefacts_differ_by_their_largest_number_and_not_by_measured_times(tmp_path: Path) -> None:
    def written(name: str, weights: list[float], seconds: float = 1.0) -> Path:
        with h5py.File(tmp_path / name, "w") as file:
            file["decoder/weights"], file["run/seconds"], file["run/iterations"] = weights, [seconds], [int(seconds)]
        return tmp_path / name

    first = written("first.h5", [1.0, -4.0, np.nan])
    assert difference(first, written("slower.h5", [1.0, -4.0, np.nan], seconds=2.0)) == 0
    assert difference(first, written("other.h5", [1.0, -4.5, np.nan])) == 0.125
    assert difference(first, written("longer.h5", [1.0, -4.0, np.nan, 0.0])) == np.inf
