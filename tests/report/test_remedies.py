"""Advice: the row that fits a bad number, with setting, new value and cost; and silence where all is well."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from ldsim.cubature.options import CubatureOptions
from ldsim.learn.options import TrainOptions
from ldsim.report.remedies import Facts, remedies
from ldsim.report.schema import RunNumbers
from ldsim.settings import Settings
from tests.report.example_report import example_report

Report = dict[str, Any]


def good() -> Report:
    """A run with nothing to complain of: motions move some 10 mm."""
    report = example_report()
    report["rounds"] = []
    report["stages"] = {name: {"seconds": 60.0 * i, "peak_memory_mb": 1.0} for i, name in enumerate(CHAIN, 1)}
    for run in report["simulate"]["latent"]:
        run["online_error"] = {"relative": 0.02, "windowed": 0.015, "max_mm": 1.0, "mean_mm": 0.2}
    for role in ("train", "test"):
        for method in report["reconstruction"][role]:
            report["reconstruction"][role][method] = {"max_mm": 0.1, "mean_mm": 0.01}
    return report


CHAIN = ("mesh", "snapshot", "pca", "train", "cubature", "simulate", "report")


def facts(
    report: Report,
    train: TrainOptions | None = None,
    loss: object = None,
    material: str = "neo_hookean",
    synthetic: bool = False,
) -> Facts:
    losses = np.full((100, 2), 0.01) if loss is None else np.asarray(loss, dtype=np.float64)
    numbers = RunNumbers.model_validate(report)
    return Facts(
        numbers, [material], 0.01, synthetic, train or TrainOptions(kind="autoencoder"), CubatureOptions(), losses
    )


def test_where_all_is_well_there_is_no_advice() -> None:
    assert remedies(facts(good())) == []


def error(role: str, relative: float, windowed: float = 0.1) -> Callable[[Report], None]:
    def change(report: Report) -> None:
        for run in report["simulate"]["latent"]:
            if run["role"] == role:
                run["online_error"] = {
                    "relative": relative,
                    "windowed": windowed,
                    "max_mm": 1.0,
                    "mean_mm": 10 * relative,
                }

    return change


def poor(*methods: str) -> Callable[[Report], None]:
    def change(report: Report) -> None:
        for method in methods:
            report["reconstruction"]["train"][method] = {"max_mm": 5.0, "mean_mm": 1.0}

    return change


def lost(report: Report) -> None:
    report["simulate"]["latent"][1] |= {"diverged": True, "online_error": None}


def stated(report: Report) -> None:
    report["statement"]["latent"] = {"error": 0.06, "median": 0.03, "lost": 0}


def rounds_ended(report: Report) -> None:
    report["rounds"] = [{"error": 0.1, "pulls": 30, "seconds": 420.0, "changed": ""}]


def few_points(report: Report) -> None:
    report["cubature"]["latent"] |= {"virtual": None, "relative_error": {"fitted": 0.2, "kept_back": 0.3}}


def on_mesh(report: Report) -> None:
    report["cubature"]["latent"]["virtual"] = None


CONDENSED = TrainOptions(kind="condensed")
FALLING = np.linspace(1, 0.1, 100)[:, None] * [1, 1]
ROWS: dict[str, tuple[list[Callable[[Report], None]], TrainOptions | None, object, str, str]] = {
    "basis": ([poor("pca_k", "autoencoder")], None, None, "pca.k", "set pca.k to 90 (now 60)"),
    "latent size": ([poor("autoencoder")], None, None, "train.r", "set train.r to 14 (now 10)"),
    "epochs": ([poor("autoencoder")], None, FALLING, "train.epochs", "set train.epochs to 800 (now 400)"),
    "motions": ([error("test", 0.4, 0.3)], None, None, "snapshot.motions", "as many pulls again take 2 min"),
    "rounds": ([error("test", 0.4, 0.3)], CONDENSED, None, "train.condensed.rounds", "rounds to 4 (now 2)"),
    "stated": ([stated], CONDENSED, None, "train.hidden", "set train.hidden to [96, 96, 96, 96] (now"),
    "rounds ended": ([stated, rounds_ended], CONDENSED, None, "--minutes", "its longest round took 7 min"),
    "forces": ([error("train", 0.4, 0.3)], None, None, "cubature.virtual.points", "points to 48 (now 24)"),
    "forces on the mesh": ([error("train", 0.4, 0.3), on_mesh], None, None, "cubature.tolerance", "0.018 (now 0.035)"),
    "condensed forces": ([error("train", 0.4, 0.3)], CONDENSED, None, "train.condensed.points", "points to 48 (now"),
    "points": ([few_points], None, None, "cubature.max_points", "set cubature.max_points to 300 (now 150)"),
    "by heart": ([], None, [[0.01, 0.5]] * 100, "train.hidden", "set train.hidden to [50, 50] (now [100, 100])"),
    "lost": ([lost], None, None, "cubature.virtual.points", "The latent run of x_2 was lost"),
    "lost on the mesh": ([lost, on_mesh], None, None, "cubature.tolerance", "The latent run of x_2 was lost"),
    "lost while it is stepped": ([lost], None, None, "mesh.time_step", "to 0.005 (now 0.01); mesh and what"),
    "condensed lost": ([lost], CONDENSED, None, "train.condensed.rounds", "The latent run of x_2 was lost"),
    "drift": ([error("test", 0.4, 0.05)], None, None, "drift", "it is 5.00 %"),
    "lasting drift": ([error("test", 40.0, 1.2)], None, None, "drift", "it is 120 %"),
}


@pytest.mark.parametrize("row", ROWS)
def test_each_bad_number_brings_its_row(row: str) -> None:
    changes, train, loss, setting, words = ROWS[row]
    report = good()
    for change in changes:
        change(report)
    found = [text for text in remedies(facts(report, train, loss)) if setting in text]
    assert found and words in found[0]


def test_what_is_set_already_is_not_advised() -> None:
    report = good()
    lost(report)
    assert "mesh.material.model to stable_neo_hookean (now neo_hookean)" in remedies(facts(report))[0]
    assert "mesh.material.model" not in remedies(facts(report, material="stable_neo_hookean"))[0]
    report = good()
    error("test", 0.4, 0.3)(report)
    assert "pca.synthetic" in remedies(facts(report))[0]
    assert "add a motion of role train" in remedies(facts(report, synthetic=True))[0]
    assert "pca.synthetic" not in remedies(facts(report, synthetic=True))[0]


def test_a_condensed_run_is_never_told_that_it_does_not_hold_the_training_poses() -> None:
    """They are told without what pulls and weight move beside its coordinates, which it has."""
    report = good()
    poor("autoencoder", "pca_k")(report)
    assert remedies(facts(report)) and remedies(facts(report, CONDENSED)) == []
    error("train", 0.4, 0.3)(report)
    (found,) = remedies(facts(report, CONDENSED))
    assert found.startswith("It is off on motions that it learned from: set train.hidden to [96, 96, 96, 96]")


def test_where_virtual_points_are_stepped_no_rule_on_the_mesh_is_advised() -> None:
    report = good()
    error("train", 0.4, 0.3)(report)
    lost(report)
    assert not any("cubature.tolerance" in text or "max_points" in text for text in remedies(facts(report)))


def test_a_run_that_was_lost_is_not_called_drift() -> None:
    report = good()
    report["simulate"]["latent"][1] |= {"diverged": True}
    report["simulate"]["latent"][1]["online_error"] |= {"relative": None, "windowed": 0.05}
    assert not any("drift" in text for text in remedies(facts(report)))


def test_costs_are_those_that_the_stages_took() -> None:
    report = good()
    poor("autoencoder")(report)
    assert "train and what follows took 22 min" in remedies(facts(report))[0]


@pytest.mark.parametrize("row", ROWS)
def test_every_setting_that_is_advised_is_one(row: str) -> None:
    """And takes the value: a configuration with it loads."""
    changes, train, loss, setting, _ = ROWS[row]
    report = good()
    for change in changes:
        change(report)
    words = " ".join(remedies(facts(report, train, loss))).replace(",", " ").replace(";", " ").split()
    for word in words:
        stage, *keys = word.strip(".:()").split(".")
        place: Any = Settings.model_fields[stage].annotation if stage in CHAIN and keys else None
        for key in keys if place is not None else ():
            assert key in place.model_fields, f"{word} is no setting"
            place = place.model_fields[key].annotation
