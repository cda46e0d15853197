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
from reproduction.bench.derived import SOLIDS, by_hand, judged, written
from reproduction.harness import row
from tests.report.small_run import write_run


def test_scene_and_motions_are_those_by_hand_and_all_else_is_what_new_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LDSIM_DATA", str(tmp_path))
    new = load_settings(by_hand("x")).replace(experiment="x_new")
    new = new.replace(train=new.train.replace(hidden=(16,)), pca=new.pca.replace(k=17, synthetic=None))
    asked = list[str]()

    def call(folder: Path, *arguments: str) -> int:
        asked.extend(arguments)
        (folder / "x_new.yaml").write_text(new.dump(defaults=False), encoding="utf-8")
        return 0

    monkeypatch.setattr(derived, "ldsim", call)
    found, hand = load_settings(written("x", tmp_path)), load_settings(by_hand("x"))
    assert found.experiment == "x" and found.train == new.train and found.pca == new.pca
    assert found.mesh == hand.mesh and found.snapshot == hand.snapshot
    assert asked[:2] == ["new", str(tmp_path / "meshes" / "x_29686.mesh")]  # a command knows no variables


@pytest.mark.parametrize("solid", SOLIDS)
def test_every_solid_has_settings_by_hand_for_a_condensed_space(solid: str) -> None:
    assert load_settings(by_hand(solid)).train.kind == "condensed"


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
