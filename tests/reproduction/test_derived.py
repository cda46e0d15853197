"""Derived settings beside those by hand: the same motions, and the errors of a role from both."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ldsim.pipeline.choice_of_space import Standing
from ldsim.report.frontier import on_role
from ldsim.run import Run
from ldsim.settings import load_settings
from reproduction.bench import derived
from reproduction.bench.derived import SOLIDS, judged, written
from reproduction.harness import row
from tests.report.small_run import write_run


@pytest.mark.parametrize("solid", SOLIDS)
def test_a_configuration_of_the_paper_says_scene_and_motions_and_no_more(solid: str, tmp_path: Path) -> None:
    found = load_settings(written(solid, tmp_path))
    assert found.experiment == solid and found.model_fields_set == {"experiment", "mesh", "snapshot"}


def test_errors_of_a_role_stand_beside_those_by_hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_run(tmp_path)
    before = [row("x", f"{what}, train, condensed, middle", 0.5) for what in ("error", "step")]
    monkeypatch.setattr(derived, "rows_before", lambda name, solid: before)
    with Run.open(tmp_path) as run:
        latent = next(each for each in on_role(run, "train") if each.space == "latent")
        found = {each["quantity"]: each["value"] for each in judged("x", "train", run)}
    assert found["error, train, derived"] == latent.error
    assert found["step, train, derived"] == pytest.approx(1e6 * latent.seconds)
    assert found["error, train, by hand, middle"] == found["step, train, by hand, middle"] == 0.5
    assert "error, train, by hand, least" not in found
    assert not [quantity for quantity in found if "(train)" in quantity]  # there is one motion


def test_of_a_role_those_motions_count_that_both_were_judged_by_and_each_is_told_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = [row("x", f"error, {motions}, condensed, middle", 0.5) for motions in ("test", "a (test)", "b (test)")]
    errors = {"a": 0.1, "b": 0.2, "fresh": 0.4, "learned": 0.8}
    roles = {name: SimpleNamespace(role="train" if name == "learned" else "test") for name in errors}
    run: Any = SimpleNamespace(simulation={"latent": dict.fromkeys(errors)}, motions=roles)
    monkeypatch.setattr(derived, "rows_before", lambda name, solid: before)
    monkeypatch.setattr(
        derived, "on_motions", lambda run, names: [Standing("latent", sum(errors[name] for name in names), 1e-6)]
    )
    found = {each["quantity"]: each["value"] for each in judged("x", "test", run) if "step" not in each["quantity"]}
    assert found == {
        "error, test, derived": pytest.approx(0.3),
        "error, test, by hand, middle": 0.5,
        "error, a (test), derived": 0.1,
        "error, a (test), by hand, middle": 0.5,
        "error, b (test), derived": 0.2,
        "error, b (test), by hand, middle": 0.5,
        "error, fresh (test), derived": 0.4,
    }
