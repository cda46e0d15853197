"""The report of a small run: every number recomputed from the arrays, what diverged shown as such, nothing left out."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from PIL import Image

from ldsim.mechanics.options import PullOptions
from ldsim.optimise.solution import Reason
from ldsim.pipeline.options import SimulateOptions, StatementOptions
from ldsim.report import pictures as pictures_module
from ldsim.report.frontier import advice
from ldsim.report.numbers import collect
from ldsim.report.options import ReportOptions
from ldsim.report.pictures import mean_displacement
from ldsim.report.report import Report, build_report, write_report
from ldsim.report.schema import STAGES, RunNumbers, check_report
from ldsim.report.verdict import verdict
from ldsim.report.wording import readable
from ldsim.run import REDUCED, SPACES, Run
from ldsim.space.novelty import Novelty
from tests.report.example_report import example_report
from tests.report.small_run import FRAMES, FULL_FRAMES, LOST_FROM, NAME, ROLES, K, R, changed, write_run

COST = {"seconds": 12.5, "peak_memory_mb": 345.5}
NO_PICTURES = ReportOptions(pictures=False)
MOTIONS = list(FRAMES)
# The frames of every motion that the full space was timed on, from its first drag on.
STRETCH = slice(2, 2 + FULL_FRAMES)


def built(run: Run, options: ReportOptions = NO_PICTURES) -> Report:
    return build_report(run, options, lambda: COST, lambda: None)


@pytest.fixture(scope="module")
def numbers(folder: Path) -> dict[str, Any]:
    with Run.open(folder) as run:
        return built(run).numbers.model_dump()


def entry(numbers: dict[str, Any], space: str, motion: str) -> dict[str, Any]:
    (found,) = (run for run in numbers["simulate"][space] if run["motion"] == motion)
    return found


def raw(folder: Path, file: str, *names: str) -> list[np.ndarray]:
    """Datasets read by h5py alone."""
    with h5py.File(folder / f"{file}.h5") as data:
        return [data[name][()] for name in names]


def rows(folder: Path, role: str) -> np.ndarray:
    fields = [raw(folder, "snapshots", f"motions/{name}/displacements")[0] for name in FRAMES if ROLES[name] == role]
    return np.concatenate(fields).astype(np.float64)


def distances_mm(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return 1000 * np.sqrt(((a.reshape(len(b), -1, 3) - b) ** 2).sum(axis=2))


def test_the_report_keeps_the_contract_and_fits_into_json(numbers):
    assert check_report(numbers) == []
    assert json.loads(json.dumps(numbers, allow_nan=False)) == numbers


def test_the_subject_is_the_scene_and_the_model(numbers):
    assert numbers["experiment"] == NAME
    assert numbers["mesh"] == {"vertices": 54, "cells": 120, "cell_type": "tet4", "quadrature_points": 120}
    assert (numbers["dims"]["k"], numbers["dims"]["r"]) == (K, R)
    assert numbers["rest_residual_mm"] == 0


@pytest.mark.parametrize("role", ["train", "validation"])
@pytest.mark.parametrize(("method", "dimension"), [("pca_r", "r"), ("pca_kp", "kp"), ("pca_k", "k")])
def test_pca_errors_are_those_of_projecting_every_frame(folder, run, numbers, role, method, dimension):
    (U,) = raw(folder, "basis", "U")
    M = np.kron(run.scene.mass.toarray(), np.eye(3))
    u = rows(folder, role)
    V = U[:, : numbers["dims"][dimension]]
    distances = distances_mm(u.reshape(len(u), -1) @ M @ V @ V.T, u)
    found = numbers["reconstruction"][role][method]
    assert found["max_mm"] == pytest.approx(distances.max(), rel=1e-9)
    assert found["mean_mm"] == pytest.approx(distances.mean(), rel=1e-9)


@pytest.mark.parametrize("role", ["train", "validation"])
def test_a_decoder_of_r_modes_errs_as_pca_with_r_modes(numbers, role):
    found = numbers["reconstruction"][role]
    assert found["autoencoder"] == pytest.approx(found["pca_r"], rel=1e-9)


def test_without_held_out_motions_there_are_no_held_out_errors(tmp_path):
    write_run(tmp_path, validation=False)
    with Run.open(tmp_path) as run:
        report = built(run)
    assert report.numbers.reconstruction.validation is None
    assert check_report(report.numbers.model_dump()) == []


def test_cubature_is_the_chosen_set(numbers):
    assert numbers["cubature"] == {
        "latent": {
            "points": 5,
            "relative_error": {"fitted": 0.05, "kept_back": 0.07},
            "virtual": None,
            "stepped": 5,
            "seconds": 3.25,
        },
        "linear": {
            "points": 8,
            "relative_error": {"fitted": 0.05, "kept_back": 0.1},
            "virtual": None,
            "stepped": 8,
            "seconds": 4.5,
        },
    }


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("space", SPACES)
def test_times_and_counts_are_those_of_the_steps(folder, numbers, space, motion):
    names = (f"runs/{space}/{motion}/{name}" for name in ("seconds", "iterations", "evaluations"))
    seconds, iterations, evaluations = raw(folder, "simulation", *names)
    found = entry(numbers, space, motion)
    assert found["role"] == ROLES[motion] and not found["diverged"]
    assert found["frames"] == (FULL_FRAMES if space == "full" else FRAMES[motion])
    ordered = sorted(1000 * seconds)
    middle = ordered[(len(ordered) - 1) // 2 : len(ordered) // 2 + 1]
    assert found["median_step_ms"] == pytest.approx(sum(middle) / len(middle))
    below, share = divmod(0.95 * (len(ordered) - 1), 1)
    low, high = ordered[int(below)], ordered[int(below) + 1]
    assert found["p95_step_ms"] == pytest.approx(low + share * (high - low))
    assert found["iterations"] == pytest.approx(sum(iterations) / len(iterations))
    assert found["evaluations"] == pytest.approx(sum(evaluations) / len(evaluations))


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("space", ["linear", "latent"])
def test_online_errors_are_distances_of_decoded_frames_to_the_snapshots(folder, numbers, space, motion):
    (U,) = raw(folder, "basis", "U")
    q, windowed = raw(
        folder, "simulation", f"runs/{space}/{motion}/coordinates", f"runs/{space}/{motion}/windowed_mean_error"
    )
    full = raw(folder, "snapshots", f"motions/{motion}/displacements")[0].astype(np.float64)
    distances = distances_mm(q @ U[:, : q.shape[1]].T, full)
    moved = 1000 * np.linalg.norm(full, axis=2).mean()
    found = entry(numbers, space, motion)["online_error"]
    assert found["relative"] == pytest.approx(distances.mean() / moved, rel=1e-9)
    assert found["windowed"] == pytest.approx(1000 * windowed.mean() / moved, rel=1e-9)
    assert found["max_mm"] == pytest.approx(distances.max(), rel=1e-9)
    assert found["mean_mm"] == pytest.approx(distances.mean(), rel=1e-9)


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_full_space_has_no_error(numbers, motion):
    assert entry(numbers, "full", motion)["online_error"] is None


@pytest.mark.parametrize(("key", "slower", "frames"), [("linear_kp", "linear", slice(None)), ("full", "full", STRETCH)])
def test_speedups_are_ratios_of_medians_over_the_same_frames_of_all_motions(folder, numbers, key, slower, frames):
    def median(space: str, some: slice) -> float:
        columns = raw(folder, "simulation", *(f"runs/{space}/{m}/seconds" for m in MOTIONS))
        return float(np.median(np.concatenate([column[some] for column in columns])))

    expected = median(slower, slice(None)) / median("latent", frames)
    assert numbers["speedup"][f"latent_over_{key}"] == pytest.approx(expected)


def test_the_ratio_at_equal_error_is_that_of_the_fastest_linear_space_that_is_as_good(folder, numbers):
    (slow,) = raw(folder, "simulation", "runs/linear/push/seconds")
    (fast,) = raw(folder, "simulation", "runs/latent/push/seconds")
    speedup, rungs = numbers["speedup"], {run["space"]: run for run in numbers["frontier"] if run["motion"] == "push"}
    assert speedup["judged_on"] == "validation" and speedup["linear_space"] == "linear"
    assert speedup["latent_error"] == pytest.approx(rungs["latent"]["online_error"])
    assert speedup["linear_error"] == pytest.approx(rungs["linear"]["online_error"])
    as_good = speedup["linear_error"] <= speedup["latent_error"]
    expected = np.median(slow) / np.median(fast) if as_good else None
    assert speedup["latent_over_linear_equal_error"] == (pytest.approx(expected) if as_good else None)


def test_every_stage_has_its_cost(numbers):
    assert list(numbers["stages"]) == list(STAGES)
    number = STAGES.index("train")
    assert numbers["stages"]["train"] == {"seconds": 1.5 + number, "peak_memory_mb": 100.25 + number}
    assert numbers["stages"]["report"] == COST


def test_a_diverged_run_is_shown_with_what_it_did_and_without_errors(lost):
    report = built(lost)
    numbers = report.numbers.model_dump()
    found = entry(numbers, "linear", "push")
    assert check_report(numbers) == []
    assert found["diverged"] and found["frames"] == LOST_FROM + 1
    error = found["online_error"]
    assert (error["relative"], error["max_mm"], error["mean_mm"]) == (None, None, None)
    assert not entry(numbers, "latent", "push")["diverged"]
    assert report.page.count('class="bad"') == 1
    assert report.page.count("linear run of motion push diverged") == 1
    (seconds,) = raw(lost.folder, "simulation", "runs/linear/push/seconds")
    assert found["median_step_ms"] == pytest.approx(1000 * np.median(seconds[: LOST_FROM + 1]))


def test_a_diverged_run_has_no_part_in_the_speedup(lost):
    slow, fast = raw(lost.folder, "simulation", "runs/linear/pull_1/seconds", "runs/latent/pull_1/seconds")
    speedup = collect(lost, ReportOptions(), COST).speedup
    assert speedup.latent_over_linear_kp == pytest.approx(np.median(slow) / np.median(fast))


def test_a_space_that_ran_nothing_leaves_nulls(run):
    numbers = collect(changed(run, "simulation", {"latent": run.simulation["latent"]}), ReportOptions(), COST)
    assert numbers.simulate.full == numbers.simulate.linear == []
    ratios = [value for name, value in numbers.speedup.model_dump().items() if name.startswith("latent_over")]
    assert ratios == [None, None, None]
    assert check_report(numbers.model_dump()) == []


def test_the_page_shows_every_motion_and_has_a_figure_of_each(run):
    report = built(run)
    curves = [f"online_error_{motion}" for motion in MOTIONS]
    assert set(report.figures) == {
        "error_against_k",
        "singular_values",
        "training",
        "cubature",
        "step_times",
        "frontier",
        *curves,
    }
    for motion in MOTIONS:
        assert f"motion {motion}: time, s" in report.page
        assert report.page.count(f"{motion} <small>") == len(SPACES) + len(REDUCED)
    assert report.page.count('<div class="plot">') == len(report.figures)


def test_a_run_without_fault_gives_no_warnings(run):
    warnings = warnings_of(run)
    assert not [text for text in warnings if "validation" not in text and "nothing was fitted to" not in text]


def warnings_of(run: Run) -> list[str]:
    page = built(run).page
    if 'class="warnings"' not in page:
        return []
    part = page.split('class="warnings"')[1].split("</section>")[0]
    return [text.split("</li>")[0] for text in part.split("<li>")[1:]]


def test_steps_that_stopped_early_are_counted(run):
    latent = run.simulation["latent"]
    reason = latent["push"].reason.copy()
    reason[[1, 4, 5]] = Reason.NO_DECREASE, Reason.ITERATIONS_SPENT, Reason.NO_DECREASE
    runs = {**run.simulation, "latent": {**latent, "push": replace(latent["push"], reason=reason)}}
    found = [text for text in warnings_of(changed(run, "simulation", runs)) if "converge" in text]
    assert found == [
        "In the latent run of motion push, 3 of 11 steps did not converge (the line search found no decrease)."
    ]


@pytest.mark.parametrize("error, told", [(0.05, []), (0.2, ["In the latent run of motion push, 2 of 11 frames"])])
def test_frames_far_from_what_was_learned_are_told_where_the_motion_is_missed_too(run, error, told):
    latent = run.simulation["latent"]
    push = latent["push"]
    scores = np.where(np.arange(len(push.seconds)) < 2, 3.0, 0.5)
    push = replace(push, novelty=scores, mean_error=error * push.mean_displacement)
    run = changed(run, "simulation", {**run.simulation, "latent": {**latent, "push": push}})
    run = changed(run, "model", replace(run.model, novelty=Novelty(np.zeros((1, R)), 1.0, 2.0)))
    found = [text for text in warnings_of(run) if "far from the training motions" in text]
    assert [text[: text.index(" are far")] for text in found] == told


def test_missed_tolerances_are_named(run):
    strict = changed(run, "cubature", settings="tolerance: 0.01")
    found = warnings_of(changed(strict, "model", settings="tolerance_mm: 0.5", met=0))
    assert sum("0.01 was asked for" in text for text in found) == 2
    assert sum("0.5 mm were asked for (train.tolerance_mm)" in text for text in found) == 1


def test_the_animation_is_in_real_time_however_short_the_steps(run, monkeypatch):
    h = run.scene.time_step
    monkeypatch.setattr(pictures_module, "ANIMATION_RATE", 1 / (3 * h))
    (stride,) = set(np.diff(pictures_module._stretch(run, "push")))
    assert stride == 3


def test_the_animation_is_of_the_motion_that_judges(run, monkeypatch):
    monkeypatch.setattr(pictures_module, "FEWEST_FRAMES", 2)
    monkeypatch.setattr(pictures_module, "ANIMATION_RATE", 1e4)
    report = built(run, ReportOptions())
    assert int(np.argmax(mean_displacement(run, "push"))) < FRAMES["push"]
    assert report.picture.file == "push.webp" and report.picture.caption in report.page
    animated = Image.open(BytesIO(report.picture.data))
    assert getattr(animated, "n_frames", 1) == FRAMES["push"]


def test_a_verdict_is_the_worst_motion_of_the_role_that_judges(numbers):
    worst = max(
        run["online_error"] for run in numbers["frontier"] if run["role"] == "validation" and run["space"] == "latent"
    )
    word = "good" if worst <= 0.1 else "usable" if worst <= 0.3 else "do not use"
    assert numbers["verdict"]["word"] == word
    assert f"within {readable(100 * worst)} % " in numbers["verdict"]["why"]


def test_verdict_and_headline_tell_one_number(run, numbers):
    """Not in the same space as latent by chance: the chosen space is another one too."""
    linear = built(changed(run, "simulation", space="linear")).numbers
    for found in (RunNumbers.model_validate(numbers), linear):
        ratio, run = found.speedup.chosen_over_full, found.headline()
        assert run is not None and run.space == found.space and run.motion == "push"
        assert found.verdict.why.endswith(
            f"it steps in {readable(run.median_step_ms)} ms, in {readable(ratio)} times less time than the full space."
        )
    assert numbers["speedup"]["chosen_over_full"] == numbers["speedup"]["latent_over_full"]
    assert linear.speedup.chosen_over_full != numbers["speedup"]["latent_over_full"]


def test_a_space_that_was_asked_for_is_not_called_the_fastest(run):
    assert "Chosen as the fastest within" in advice(run)[0]
    asked = changed(run, "simulation", settings=SimulateOptions(space="linear").dump(), space="linear")
    assert advice(asked)[0].startswith("As simulate.space says, used is the linear space")
    assert "Chosen" not in advice(asked)[0]


def test_where_every_space_diverged_none_is_to_be_used(run):
    lost = {
        space: {name: replace(each, reason=0 * each.reason + Reason.INFINITE_START) for name, each in own.items()}
        for space, own in run.simulation.items()
    }
    asked = SimulateOptions(space="linear").dump()
    for settings in ("", asked):
        (said,) = advice(changed(run, "simulation", lost, settings, space="linear" if settings else "latent"))
        assert said == "Every space diverged on the validation motions, so none is to be used."


@pytest.mark.parametrize(("space", "named"), [("latent", False), ("linear", True)])
def test_the_statement_is_of_the_latent_space_and_says_so_where_another_is_used(run, monkeypatch, space, named):
    fresh = {name: np.linspace(0.01, 0.04, 59) for name in REDUCED}
    monkeypatch.setattr(Run, "fresh_errors", fresh)
    options = SimulateOptions(space=space, statement=StatementOptions(pulls=PullOptions(count=1, reach=0.1)))
    found = collect(changed(run, "simulation", settings=options.dump(), space=space), ReportOptions(), COST)
    assert ("4 % of the full space in the latent space (" in found.statement.sentence) == named
    assert ("4 % of the full space (" in found.statement.sentence) != named


@pytest.mark.parametrize(
    ("error", "word"), [(0.09, "good"), (0.29, "usable"), (0.31, "do not use"), (None, "do not use")]
)
def test_a_verdict_in_words(error, word):
    report = example_report() | {"statement": None}
    report["frontier"][0]["online_error"] = error
    report["simulate"]["latent"][1]["diverged"] = error is None
    found = verdict(RunNumbers.model_validate(report))
    assert found.word == word and found.why.startswith("the latent space of 10 numbers")


def test_a_linear_space_that_nothing_was_compared_with_is_not_called_lost():
    """As where simulate.material is another one than that of the full-space runs."""
    report = example_report() | {"statement": None, "space": "linear"}
    for run in report["frontier"]:
        run |= {"space": "linear", "online_error": None}
    assert verdict(RunNumbers.model_validate(report)).word == "not judged"
    report["frontier"].append(report["frontier"][0] | {"space": "latent", "online_error": 0.1})
    assert verdict(RunNumbers.model_validate(report)).word == "do not use"


@pytest.mark.parametrize(("lost", "word"), [("latent", "not judged"), ("linear", "do not use")])
def test_a_linear_space_is_called_lost_where_it_was_and_not_where_the_latent_one_was(lost, word):
    report = example_report() | {"statement": None, "space": "linear"}
    for run in report["frontier"]:
        run |= {"space": "linear", "online_error": None}
    report["simulate"][lost][-1]["diverged"] = True
    assert verdict(RunNumbers.model_validate(report)).word == word


def test_a_statement_is_the_verdict_where_there_is_one():
    assert verdict(RunNumbers.model_validate(example_report())).why.startswith(
        "the latent space of 10 numbers stays within 4.63 %"
    )


def test_a_statement_of_a_small_share_of_motions_is_not_what_the_verdict_rests_on():
    report = example_report()
    report["statement"] |= {"motions": 1, "quantile": 0.05}
    found = verdict(RunNumbers.model_validate(report))
    assert (
        found.word == "do not use" and "stays within 33.1 % of the mean displacement on the test motions" in found.why
    )


def test_a_verdict_by_the_statement_names_the_share_of_motions_and_the_confidence_unrounded():
    report = example_report()
    report["statement"] |= {"quantile": 0.995, "confidence": 0.996}
    assert (
        "within 4.63 % of how far fresh motions move it, in 99.5 % of them (99.6 % confidence)"
        in verdict(RunNumbers.model_validate(report)).why
    )


def test_too_many_lost_fresh_motions_are_a_verdict_too():
    report = example_report()
    report["statement"]["latent"] |= {"error": None, "lost": 7}
    found, motions = verdict(RunNumbers.model_validate(report)), report["statement"]["motions"]
    assert found.word == "do not use"
    assert found.why == f"the latent space of 10 numbers was lost in 7 of {motions} fresh motions."


def test_a_folder_is_replaced_whole_and_the_page_comes_last(run, tmp_path):
    report = built(run, ReportOptions())
    target = tmp_path / "report"
    target.mkdir()
    (target / "old").write_text("stale")
    write_report(target, report)
    assert json.loads((target / "report.json").read_text()) == report.numbers.model_dump()
    files = {str(path.relative_to(target)) for path in target.rglob("*") if path.is_file()}
    assert files == {
        *("report.json", "report.html"),
        *(f"figures/{name}.{kind}" for name in report.figures for kind in ("svg", "json")),
        *([f"pictures/{report.picture.file}"] if report.picture else []),
    }
    page = (target / "report.html").stat().st_mtime_ns
    assert all((target / name).stat().st_mtime_ns <= page for name in files)
    assert [path.name for path in tmp_path.iterdir()] == ["report"]


def test_numbers_that_are_not_finite_become_null(run):
    errors = np.array([[np.nan, np.inf], [np.nan, np.nan]])
    numbers = collect(changed(run, "model", replace(run.model, errors=errors)), ReportOptions(), COST).model_dump()
    assert numbers["reconstruction"]["train"]["autoencoder"] == {"max_mm": None, "mean_mm": None}
    assert not any(isinstance(value, float) and not math.isfinite(value) for value in leaves(numbers))


def leaves(value: Any) -> list[Any]:
    if not isinstance(value, dict | list):
        return [value]
    return [leaf for child in (value.values() if isinstance(value, dict) else value) for leaf in leaves(child)]
