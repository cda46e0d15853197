"""Rows and pictures of the frontiers: of every seed what was measured, and no ratio that a seed lacks."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from ldsim.errors import SettingsError
from ldsim.report.frontier import on_motions, on_role
from ldsim.run import Run
from ldsim.settings import load_settings
from reproduction.bench.condensed import GOALS, asked
from reproduction.bench.derived import SOLIDS
from reproduction.bench.frontier import (
    ERROR,
    STEP,
    compared,
    compared_with,
    farther,
    marks,
    over_seeds,
    picture,
    rows_of,
    seeded,
)
from reproduction.harness import CONFIGS, Row, row
from tests.report.small_run import ROLES, write_run

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


def test_a_latent_space_that_was_lost_has_no_ratios() -> None:
    rows = compared("solid", [*measured("autoencoder 9", math.inf, 10), *measured("linear 9", 0.1, 10)])
    values = {each["quantity"]: each["value"] for each in rows}
    assert values["error, test, autoencoder, seed 1"] is None
    assert values["error, test, best linear, seed 1"] == 0.1
    assert not [each for each in values if " over " in each]


def measured(space: str, error: float, us: float, seed: int = 1) -> list[Row]:
    label = f"test, {space}, 24 points, seed {seed}"
    return [row("solid", f"{ERROR}, {label}", error), row("solid", f"{STEP}, {label}", us / 1e3, "ms")]


def test_every_space_of_a_run_is_measured_and_linear_ones_where_they_are_wanted(tmp_path: Path) -> None:
    write_run(tmp_path)
    with Run.open(tmp_path) as run:
        role = next(role for role in ("test", "validation", "train") if on_role(run, role))
        spaces = on_role(run, role)
        all_of_them, latent = (rows_of("solid", "autoencoder", 1, run, linear) for linear in (True, False))
    for rows, count in ((all_of_them, len(spaces)), (latent, 1)):
        for what in (ERROR, STEP):
            assert sum(each["quantity"].startswith(f"{what}, {role}") for each in rows) == count
    assert {(mark.error, mark.ms) for mark in marks(all_of_them, role)} == {
        (each.error, 1e3 * each.seconds) for each in spaces
    }


def test_where_a_role_has_several_motions_each_has_its_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ROLES, "push", "train")
    write_run(tmp_path)
    with Run.open(tmp_path) as run:
        rows = rows_of("solid", "autoencoder", 1, run, linear=True)
        alone = {name: on_motions(run, [name]) for name in ("pull_1", "push")}
    for name, spaces in alone.items():
        assert [mark.error for mark in marks(rows, f"{name} (train)")] == [each.error for each in spaces]
    names = {each["quantity"] for each in compared("solid", rows)}
    assert {f"error, {motions}, autoencoder, seed 1" for motions in ("train", "push (train)")} < names


def test_a_condensed_space_has_its_goal_on_what_it_did_not_learn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(ROLES, "push", "validation")
    monkeypatch.setitem(GOALS, "solid", 0.02)
    write_run(tmp_path)
    with Run.open(tmp_path) as run:
        rows, others = (rows_of("solid", kind, 1, run, linear=True) for kind in ("condensed", "autoencoder"))
    with_goal = {each["quantity"]: each["goal"] for each in rows if each["goal"] is not None}
    assert set(with_goal.values()) == {"<= 0.02"}
    assert [name.startswith(f"{ERROR}, validation, condensed") for name in with_goal] == [True]
    assert not [each for each in others if each["goal"] is not None]


def test_motions_have_a_goal_together_where_it_is_one_and_the_same() -> None:
    assert asked("elephant", ["elephant"]) == "<= 0.05"
    assert asked("elephant", ["others", "gentle"]) == "<= 0.02"
    assert asked("elephant", ["others", "local_effect"]) is None
    assert asked("no solid of ours", ["others"]) is None


def test_a_latent_space_is_compared_with_the_fastest_as_good_and_with_the_best_of_its_seed() -> None:
    rows = [*measured("condensed 9", 0.1, 10), *measured("autoencoder 9", 0.01, 10), *measured("condensed 9", 1, 1, 2)]
    rows += [*measured("linear 20", 0.1, 30), *measured("linear 40", 0.05, 60), *measured("linear 9", 0.5, 5)]
    values = {each["quantity"]: each["value"] for each in compared("solid", rows)}
    assert values[f"{RATIO}, seed 1"] == pytest.approx(3)
    assert values["least linear error over latent error, test, condensed, seed 1"] == pytest.approx(0.5)
    assert values["error, test, best linear, seed 1"] == 0.05
    assert values["step, test, best linear, seed 1"] == pytest.approx(60)  # microseconds
    # none is as good as the autoencoder, and the other seed has no linear spaces
    assert values[RATIO.replace("condensed", "autoencoder") + ", seed 1"] is None
    assert f"{RATIO}, seed 2" not in values and "error, test, best linear, seed 2" not in values


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
    spaces = {"linear 20, 24 points": (0.03, 0.1), "condensed 10, 24 points": (0.02, 0.02)}
    rows = []
    for label, (ms, error) in spaces.items():
        for seed in (1, 2):
            lost = label.startswith("linear") and seed == 2
            rows.append(row("solid", f"{STEP}, test, {label}, seed {seed}", ms * seed, "ms"))
            rows.append(row("solid", f"{ERROR}, test, {label}, seed {seed}", float("inf") if lost else error))
    expected = [
        ("linear", 20, 1, 0.03, 0.1),
        ("linear", 20, 2, 0.06, math.inf),
        ("condensed", 10, 1, 0.02, 0.02),
        ("condensed", 10, 2, 0.04, 0.02),
    ]
    assert list(marks(rows, "test")) == expected and not list(marks(rows, "validation"))
    drawn = picture(rows, "solid")
    assert all(word in drawn for word in (">condensed<", ">linear<", ">20<", ">10<"))


@pytest.mark.parametrize("solid", ["demo", *SOLIDS])
def test_an_autoencoder_has_scene_and_motions_of_the_condensed_space_and_its_basis_is_for_both(solid: str) -> None:
    condensed = load_settings(CONFIGS / f"{solid}.yaml")
    other = compared_with(condensed)
    assert (other.train.kind, condensed.train.kind) == ("autoencoder", "condensed")
    assert other.mesh == condensed.mesh and other.snapshot == condensed.snapshot
    own, again = seeded(condensed, 3, other), seeded(other, 3, other)
    assert own.experiment == again.experiment == solid and own.pca == again.pca == other.pca != condensed.pca
    assert own.train.seed == own.cubature.seed == again.cubature.seed == 3
    assert own.cubature.linear_sizes == ()  # which are fitted once
    assert again.cubature.linear_sizes == other.cubature.linear_sizes != ()


def test_a_solid_that_nothing_is_compared_with_is_named() -> None:
    with pytest.raises(SettingsError, match="autoencoders.yaml has no surface; it has demo, x, beam, "):
        compared_with(load_settings(CONFIGS / "surface.yaml"))


def test_synthetic_pulls_go_farther_and_nothing_else_changes() -> None:
    near = compared_with(load_settings(CONFIGS / "demo.yaml"))
    far = farther(near, 1.5)
    assert near.pca.synthetic is not None and far.pca.synthetic is not None
    assert far.pca.synthetic.reach == 1.5 * near.pca.synthetic.reach
    assert far.experiment == "demo_far"
    same = near.pca.replace(synthetic=near.pca.synthetic)
    assert far.model_copy(update={"experiment": "demo", "pca": same}) == near
    assert farther(near, 1) is near
