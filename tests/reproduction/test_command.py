"""`make paper`: three things for each experiment, made once, and one line for what cannot be made."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from ldsim.artefacts.store import STAGE_OF
from reproduction import harness
from reproduction.harness import Harness
from reproduction.paper import command
from reproduction.paper.experiment import Experiment, Outcome, Relation
from reproduction.paper.table import EXPERIMENTS
from tests.cli.experiments import refused

FIGURE = "<svg></svg>"


class TinyHarness(Harness):
    """Makes every run a few seconds' work."""

    def made(self, configuration: Mapping[str, Any], last: str) -> Path:
        tiny = copy.deepcopy(dict(configuration))
        tiny["mesh"]["shape"]["resolution"] = 1
        tiny["snapshot"] |= {"workers": 1}
        for motion in tiny["snapshot"]["motions"]:
            if "pulls" in motion:
                motion["pulls"] |= {"count": 2, "frames": 12, "rest": 8}
            else:
                motion["frames"] = 40
        tiny["train"] |= {"epochs": 20, "hidden": [8]}
        tiny["pca"] = {"k": min(tiny["pca"]["k"], 20)}
        return super().made(tiny, last)


def invoke(*arguments: str, runs: Path) -> Result:
    return CliRunner().invoke(command.command, [*arguments, "--runs", str(runs)])


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "Harness", TinyHarness)


def in_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is made in full size goes there, and not among the project's own results."""
    for name in ("RESULTS", "PICTURES"):
        monkeypatch.setattr(command, name, folder)
    monkeypatch.setattr(harness, "MADE", folder / "made.json")


def made_up(value: float) -> Experiment:
    def run(bench: Harness) -> Outcome:
        kept = bench.remembered("a number", lambda: {"value": value})
        return Outcome(FIGURE, {"kept": kept, "wild": [float("nan")]}, (Relation("the number", kept["value"], "< 1"),))

    return Experiment("nothing", run, "nothing either")


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize("name", ["fig2", "fig9"])
def test_an_experiment_leaves_a_picture_a_record_and_a_verdict(name: str, tmp_path: Path) -> None:
    result = invoke(name, "--quick", runs=tmp_path)
    assert result.exit_code == 0, result.output
    folder = tmp_path / "paper" / f"{name}-quick"
    assert (folder / f"paper_{name}.svg").read_text("utf-8").startswith("<svg")
    record = json.loads((folder / f"{name}.json").read_text("utf-8"))
    assert record["experiment"] == name
    assert record["passed"] == all(relation["holds"] for relation in record["relations"])
    assert f"{name}: {EXPERIMENTS[name].shows}: {'passed' if record['passed'] else 'FAILED'}" in result.output
    assert [line.strip().split(":")[0] for line in result.output.splitlines() if ", expected " in line] == [
        "holds" if relation["holds"] else "FAILS" for relation in record["relations"]
    ]
    artefacts = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.h5")}
    assert artefacts
    assert invoke(name, "--quick", runs=tmp_path).exit_code == 0
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.h5")} == artefacts


@pytest.mark.usefixtures("tiny")
def test_a_changed_setting_makes_its_stage_and_those_after_it_again(tmp_path: Path) -> None:
    bench = TinyHarness(tmp_path, "some", True)
    configuration: dict[str, Any] = {
        "experiment": "some",
        "mesh": {
            "shape": {"name": "beam"},
            "material": {"youngs_modulus": 1e5},
            "pins": [{"slab": {"axis": "x", "thickness": 0.001}}],
        },
        "snapshot": {"motions": [{"name": "a", "pulls": {"count": 1, "reach": 0.1}}]},
        "pca": {"k": 4},
        "train": {"kind": "autoencoder", "r": 2},
    }
    folder = bench.made(configuration, "train")
    before = {path.name: path.stat().st_mtime_ns for path in folder.glob("*.h5")}
    bench.made(configuration | {"pca": {"k": 5}}, "train")
    after = {path.name: path.stat().st_mtime_ns for path in folder.glob("*.h5")}
    kinds = [kind for kind in STAGE_OF if f"{kind}.h5" in before]
    expected = {f"{kind}.h5" for kind in kinds[kinds.index("basis") :]}
    assert {name for name in after if after[name] != before[name]} == expected > {"model.h5"}


def test_what_is_remembered_is_not_computed_again(tmp_path: Path) -> None:
    bench = Harness(tmp_path, "some", False)
    assert bench.remembered("a", lambda: {"value": 1}) == {"value": 1}
    assert bench.remembered("a", lambda: {"value": 2}) == {"value": 1}
    assert bench.remembered("b", lambda: {"value": 2}) == {"value": 2}


def test_a_relation_that_does_not_hold_is_shown_with_its_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(EXPERIMENTS, "odd", made_up(3.0))
    in_folder(tmp_path, monkeypatch)
    result = invoke("odd", runs=tmp_path)
    assert result.exit_code == 0
    assert "odd: nothing: FAILED" in result.output
    assert "FAILS: the number: 3, expected < 1" in result.output
    record = json.loads((tmp_path / "paper" / "odd.json").read_text("utf-8"))
    assert (tmp_path / "paper_odd.svg").is_file()
    made = json.loads((tmp_path / "made.json").read_text("utf-8"))
    assert list(made["paper_odd.svg"]) == [str(tmp_path / "paper" / "odd.json")]
    assert not record["passed"]
    assert record["numbers"]["wild"] == [None]


def test_a_result_knows_what_it_follows_from() -> None:
    profile = command.inputs("fig12")
    assert {"ldsim/dynamics", "reproduction/paper/timing.py", "reproduction/paper/evaluation.py"} < set(profile)
    assert not {"reproduction/paper/table.py", "reproduction/paper/pendulum.py"} & set(profile)


def test_all_goes_on_after_an_experiment_that_lacks_its_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LDSIM_DATA", raising=False)
    monkeypatch.setattr(command, "EXPERIMENTS", {"fig10": EXPERIMENTS["fig10"], "good": made_up(0.5)})
    in_folder(tmp_path, monkeypatch)
    result = invoke("all", runs=tmp_path)
    assert "fig10 could not be made" in refused(result)
    assert "fig10: not made: $LDSIM_DATA/meshes/catapult_13802.mesh needs the environment variable" in result.output
    assert "passed: good" in result.output


@pytest.mark.parametrize("name", ["fig10", "fig12", "fig15"])
def test_missing_data_is_one_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LDSIM_DATA", raising=False)
    assert "needs the environment variable LDSIM_DATA" in refused(invoke(name, runs=tmp_path))


def test_an_unknown_experiment_is_named_beside_those_there_are(tmp_path: Path) -> None:
    assert refused(invoke("fig99", runs=tmp_path)).startswith("there is no experiment 'fig99'; known are all, list, ")


def test_the_list_names_every_experiment(tmp_path: Path) -> None:
    lines = invoke("list", runs=tmp_path).output.splitlines()
    assert [line.split()[0] for line in lines] == list(EXPERIMENTS)
