"""`ldsim list`, `ldsim info RUN`, `ldsim open RUN`: runs in a few lines."""

from __future__ import annotations

import json
import shutil
import webbrowser
from pathlib import Path

import pytest

from ldsim.report.overview import listed, missed
from tests.cli.experiments import WRITES, Experiment, invoked, refused
from tests.helpers import changed
from tests.report.example_report import example_report


def said(*arguments: str) -> list[str]:
    result = invoked(*arguments)
    assert result.exit_code == 0, result.output
    return result.stdout.splitlines()


def test_runs_are_listed_with_how_far_they_have_come(experiment: Experiment) -> None:
    runs = experiment.folder / "runs"
    shutil.copytree(experiment.run, runs / "half")
    for name in ("model.h5", "cubature.h5", "simulation.h5"):
        (runs / "half" / name).unlink()
    shutil.rmtree(runs / "half" / "report")
    (runs / "no run").mkdir()
    head, *rows = said("list", "--runs", str(runs))
    assert head.split() == ["run", "state", "cells", "verdict", "space", "error", "step", "changed"]
    found = {row.split()[0]: row for row in rows}
    assert set(found) == {"tiny", "half"}
    verdict = json.loads((runs / "tiny" / "report" / "report.json").read_text("utf-8"))["verdict"]["word"]
    assert all(word in found["tiny"] for word in ("finished", f" {verdict} ", " % ", " µs "))
    assert "done up to pca" in found["half"]


def test_info_tells_the_verdict_first_the_statement_and_the_warnings(experiment: Experiment) -> None:
    lines = said("info", str(experiment.run))
    report = json.loads((experiment.run / "report" / "report.json").read_text("utf-8"))
    assert lines[0] == f"{report['verdict']['word']}: {report['verdict']['why']}"
    assert lines[1] == report["statement"]["sentence"]
    assert [line for line in lines if "warning" in line] == [f"  warning: {text}" for text in report["warnings"]]
    assert lines[-1].strip() == str((experiment.run / "report" / "report.html").resolve())
    assert sum(f"  {name} (" in line for line in lines for name in "ab") == 2


def test_a_report_of_what_has_been_made_anew_since_says_so(experiment: Experiment) -> None:
    listed, told = ("list", "--runs", str(experiment.folder / "runs")), ("info", str(experiment.run))
    assert "outdated" not in said(*listed)[1] and not said(*told)[0].startswith("warning")
    with changed(experiment.run / "model.h5") as file:
        file.attrs["seconds"] = "1"
    assert "report is outdated" in said(*listed)[1]
    assert said(*told)[0].startswith("warning: what the report tells of was made anew since")


@pytest.mark.parametrize("missing", [*WRITES.values(), "report"])
def test_info_of_an_unfinished_run_says_where_it_stands(experiment: Experiment, missing: str) -> None:
    path = experiment.run / missing
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    result = invoked("info", str(experiment.run))
    if missing == "scene.h5":
        assert "is not the folder of a run" in refused(result)
    else:
        assert result.exit_code == 0 and "done up to" in result.stdout


def test_open_shows_the_report_in_the_browser(experiment: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: not opened.append(address))
    page = (experiment.run / "report" / "report.html").resolve()
    assert said("open", str(experiment.run)) == [str(page)]
    assert opened == [page.as_uri()]
    assert said("open", str(experiment.run), "--no-browser") == [str(page)] and len(opened) == 1


def test_what_is_not_there_is_refused(experiment: Experiment, tmp_path: Path) -> None:
    assert "holds no run" in refused(invoked("list", "--runs", str(tmp_path / "none")))
    shutil.rmtree(experiment.run / "report")
    assert "has no report yet (done up to simulate)" in refused(invoked("open", str(experiment.run)))


@pytest.mark.parametrize(
    ("remedies", "kind", "turn"),
    [
        (["this"], "condensed", "the report says what to change"),
        ([], "condensed", "it goes on learning"),
        ([], "autoencoder", "an autoencoder is not extended; train.kind: condensed is"),
    ],
)
def test_who_asked_for_less_is_told_what_helps(
    experiment: Experiment, remedies: list[str], kind: str, turn: str
) -> None:
    """The report names nothing where the error is not bad, only larger than was asked for."""
    path = experiment.run / "report" / "report.json"
    content = json.loads(path.read_text(encoding="utf-8")) | {"remedies": remedies, "kind": kind}
    content["statement"]["latent"]["error"] = 0.03
    path.write_text(json.dumps(content), encoding="utf-8")
    (words,) = missed(experiment.run, 1.0)
    assert words.startswith("the stated error is 3 %, asked were 1 %") and words.endswith(turn)
    assert missed(experiment.run, 3.0) == []


def write_report(folder: Path, **changes: object) -> None:
    (folder / "report").mkdir(parents=True)
    (folder / "scene.h5").touch()
    (folder / "report" / "report.json").write_text(json.dumps(example_report() | changes), encoding="utf-8")


@pytest.mark.parametrize(
    ("kind", "points"), [("autoencoder", "cubature.virtual.points"), ("condensed", "train.condensed.points")]
)
def test_who_asked_for_faster_steps_is_told_which_points_the_latent_space_is_stepped_with(
    kind: str, points: str, tmp_path: Path
) -> None:
    write_report(tmp_path, kind=kind)
    (words,) = missed(tmp_path, microseconds=100.0)
    assert words == f"a step takes 243 µs, asked were 100; fewer of train.hidden, {points} and train.r make it faster"
    assert missed(tmp_path, microseconds=250.0) == []


def test_the_list_tells_the_error_that_the_verdict_rests_on(tmp_path: Path) -> None:
    statement = example_report()["statement"]
    write_report(tmp_path / "most")
    write_report(tmp_path / "few", statement=statement | {"motions": 1, "quantile": 0.05})
    found = {row.split()[0]: row for row in listed(tmp_path)[1:]}
    assert " 4.6 % " in found["most"] and " 33 % " in found["few"]
