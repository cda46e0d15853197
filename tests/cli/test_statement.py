"""The statement from its option to the report: fresh motions, run once, judged in both reduced spaces."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ldsim.artefacts.snapshots import Snapshots
from ldsim.errors import SolverError
from ldsim.pipeline import simulate as simulating
from ldsim.pipeline.statement import bound
from ldsim.run import Run
from tests.cli.experiments import Experiment, refusal


def test_the_statement_is_of_the_online_errors_of_fresh_motions(experiment: Experiment) -> None:
    with Run(experiment.run) as run:
        errors = run.fresh_errors
        assert set(errors) == {"latent", "linear"} and all(len(each) == 5 for each in errors.values())
        assert all((each > 0).all() for each in errors.values())
        with Snapshots(run.path("fresh"), kind="tests") as fresh:
            points = [tuple(fresh.recorded(name).motion.drags[0].point) for name in fresh.names]
            learned = [tuple(drag.point) for name in run.played.names for drag in run.recorded(name).motion.drags]
        assert len(points) == 5 and len(learned) == 3
    report = json.loads((experiment.run / "report" / "report.json").read_text("utf-8"))["statement"]
    said = bound(errors["latent"], 0.95, 0.95)
    assert report["motions"] == 5 and report["quantile"] == said.quantile < 0.95
    assert report["latent"]["error"] == (said.error if np.isfinite(said.error) else None)
    assert report["sentence"] in (experiment.run / "report" / "report.html").read_text("utf-8")


def test_fresh_motions_are_run_again_only_where_they_or_the_solid_changed(experiment: Experiment) -> None:
    fresh = experiment.run / "fresh.h5"
    before = fresh.read_bytes()

    def simulated(key: str, value: object) -> bytes:
        experiment.change(f"simulate.statement.{key}", value)
        result = experiment.invoke("simulate")
        assert result.exit_code == 0, result.output
        assert "fresh ones" in result.stderr
        return fresh.read_bytes()

    assert simulated("quantile", 0.5) == before
    changed = simulated("pulls.seed", 10)
    assert changed != before and not (experiment.run / "fresh.partial" / "fresh_0.frames").exists()


def test_fresh_motions_are_run_again_where_the_run_became_quasi_static(experiment: Experiment) -> None:
    fresh = experiment.run / "fresh.h5"
    before = fresh.read_bytes()
    experiment.change("snapshot.quasistatic", True)
    for stage in ("snapshot", "pca", "train", "cubature", "simulate"):
        result = experiment.invoke(stage)
        assert result.exit_code in ((0, 3) if stage == "cubature" else (0,)), result.output
    assert fresh.read_bytes() != before


def test_fresh_motions_come_before_the_comparisons_which_are_not_kept(
    experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever is interrupted in the long ones loses nothing."""
    compared = list[object]()

    def interrupted(*given: object) -> object:
        raise SolverError("interrupted")

    monkeypatch.setattr(simulating, "fresh_errors", interrupted)
    monkeypatch.setattr(simulating, "compare_motion", lambda *given: compared.append(given) or ())
    assert refusal(experiment, "simulate") == "interrupted"
    assert not compared


def test_without_a_statement_nothing_fresh_is_run(experiment: Experiment) -> None:
    (experiment.run / "fresh.h5").unlink()
    experiment.change("simulate.statement", ...)
    for stage in ("simulate", "report"):
        assert experiment.invoke(stage).exit_code == 0
    assert not (experiment.run / "fresh.h5").exists()
    assert json.loads((experiment.run / "report" / "report.json").read_text("utf-8"))["statement"] is None
