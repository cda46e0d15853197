"""Rows and pictures of the frontiers: of every seed what was measured, and no ratio that a seed lacks."""

from __future__ import annotations

from pathlib import Path

import pytest

from ldsim.pipeline.choice_of_space import Standing
from ldsim.report.frontier import on_role
from ldsim.run import Run
from ldsim.settings import load_settings
from reproduction.bench import frontier
from reproduction.bench.frontier import ERROR, STEP, marks, over_seeds, picture, rows_of, seeded
from reproduction.harness import ROOT, Row, row
from tests.report.small_run import write_run

RATIO = "linear step over latent step at equal error, test, condensed"


def test_a_ratio_has_its_range_over_the_seeds_and_none_where_a_seed_lacks_it() -> None:
    rows = [row("solid", f"{RATIO}, seed {seed}", value) for seed, value in ((1, 3.0), (2, 1.0), (3, 2.0))]
    assert told(over_seeds("solid", rows)) == {"least": 1.0, "middle": 2.0, "largest": 3.0}
    without = over_seeds("solid", [*rows[:2], row("solid", f"{RATIO}, seed 3", float("nan"))])
    assert told(without) == {"seeds in which the latent space was lost": 0, "seeds that have none": 1}
    lost = over_seeds("solid", rows[:2])
    assert told(lost) == {"seeds in which the latent space was lost": 1, "seeds that have none": 0}


def told(rows: list[Row]) -> dict[str, float]:
    return {each["quantity"].removeprefix(f"{RATIO}, "): each["value"] for each in rows}


def test_a_latent_space_that_was_lost_has_no_ratios(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_run(tmp_path)
    spaces = [Standing("latent", float("inf"), 1e-5), Standing("linear", 0.1, 1e-5)]
    monkeypatch.setattr(frontier, "on_role", lambda run, role: spaces if role == "train" else [])
    with Run.open(tmp_path) as run:
        rows = rows_of("solid", "autoencoder", 1, run, {})
    assert [each["value"] for each in rows if each["quantity"].startswith(ERROR)] == [None, 0.1]
    assert not [each for each in rows if " over " in each["quantity"]]


def test_every_space_of_a_run_is_measured_and_the_latent_one_beside_the_rivals_of_its_seed(tmp_path: Path) -> None:
    write_run(tmp_path)
    with Run.open(tmp_path) as run:
        role = next(role for role in ("test", "validation", "train") if on_role(run, role))
        spaces = on_role(run, role)
        latent = next(each for each in spaces if each.space == "latent")
        rows = rows_of("solid", "autoencoder", 1, run, {})
        # a linear space of the same seed that another run has measured: as good, and three times as slow
        rivals = {(1, role): [Standing("linear_9", 0.9 * latent.error, 3 * latent.seconds)]}
        beside = rows_of("solid", "condensed", 1, run, rivals)
    assert sum(each["quantity"].startswith(f"{ERROR}, {role}") for each in rows) == len(spaces)
    assert sum(each["quantity"].startswith(f"{STEP}, {role}") for each in beside) == 1
    ratio = next(each for each in beside if each["quantity"] == RATIO.replace("test", role) + ", seed 1")
    assert ratio["value"] == pytest.approx(3)
    told = {each["quantity"]: each["value"] for each in [*rows, *beside]}
    assert told[f"error, {role}, autoencoder, seed 1"] == told[f"error, {role}, condensed, seed 1"] == latent.error
    assert told[f"step, {role}, condensed, seed 1"] == pytest.approx(1e6 * latent.seconds)  # microseconds
    least = min(each.error for each in spaces if each.space != "latent")
    assert told[f"error, {role}, best linear, seed 1"] == least
    # the linear spaces of a seed are told once, with the run that they were fitted in
    assert not [each for each in beside if f"{role}, best linear" in each["quantity"]]


def test_errors_and_steps_have_a_range_over_the_seeds_too() -> None:
    rows = [
        row("solid", f"{what}, test, condensed, seed {seed}", seed / 10)
        for what in ("error", "step")
        for seed in (3, 1, 2)
    ]
    rows += [row("solid", f"online error, test, linear 9, 4 points, seed {seed}", 1.0) for seed in (1, 2, 3)]
    summed = {each["quantity"]: each["value"] for each in over_seeds("solid", rows)}
    assert len(summed) == 6
    assert summed["error, test, condensed, middle"] == summed["step, test, condensed, middle"] == pytest.approx(0.2)


def test_the_picture_has_a_mark_for_every_space_that_was_not_lost() -> None:
    measured = {"linear 20, 24 points": (0.03, 0.1), "condensed 10, 24 points": (0.02, 0.02)}
    rows = []
    for label, (ms, error) in measured.items():
        for seed in (1, 2):
            lost = label.startswith("linear") and seed == 2
            rows.append(row("solid", f"{STEP}, test, {label}, seed {seed}", ms * seed, "ms"))
            rows.append(row("solid", f"{ERROR}, test, {label}, seed {seed}", float("inf") if lost else error))
    expected = [("linear", 20, 1, 0.03, 0.1), ("condensed", 10, 1, 0.02, 0.02), ("condensed", 10, 2, 0.04, 0.02)]
    assert list(marks(rows, "test")) == expected and not list(marks(rows, "validation"))
    drawn = picture(rows, "solid")
    assert all(word in drawn for word in (">condensed<", ">linear<", ">20<", ">10<"))


def test_configurations_of_other_names_are_seeded_as_one_experiment_whose_linear_sizes_are_fitted_once() -> None:
    first = load_settings(ROOT / "reproduction" / "bench" / "frontier_demo.yaml")
    other = load_settings(ROOT / "configs" / "surface.yaml")
    assert other.experiment != first.experiment
    own, again = seeded(other, 3, first), seeded(first, 3, first)
    assert own.experiment == again.experiment == first.experiment
    assert own.train.seed == own.cubature.seed == again.cubature.seed == 3
    assert own.cubature.linear_sizes == ()
    assert again.cubature.linear_sizes == first.cubature.linear_sizes != ()
