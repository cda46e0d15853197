"""Warnings: each arises from its cause and from nothing else."""

from __future__ import annotations

import pytest

from ldsim.report.schema import RunNumbers
from ldsim.report.warnings import warnings_of_numbers
from tests.report.example_report import example_report


def warnings_of(report):
    return warnings_of_numbers(RunNumbers.model_validate(report), cubature_tolerance=0.1)


def harmless_report():
    report = example_report()
    report["reconstruction"]["test"]["autoencoder"]["max_mm"] = 5.0
    for space in ("linear", "latent"):
        report["cubature"][space]["relative_error"]["kept_back"] = 0.09
    for space in ("linear", "latent"):
        for run in report["simulate"][space]:
            run["online_error"]["relative"] = 0.02
    return report


def test_a_good_run_gives_none():
    assert warnings_of(harmless_report()) == []


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        (("simulate", "linear", 0, "diverged"), True, "linear run of motion x_2 diverged"),
        (("simulate", "latent", 1, "online_error", "relative"), 0.3313, "33.1 %"),
        (("cubature", "linear", "relative_error", "fitted"), 0.384, "error of 0.384 on fitted poses; 0.1 was"),
        (("cubature", "latent", "relative_error", "kept_back"), 0.284, "error of 0.284 on poses kept back; 0.1 was"),
        (("speedup", "latent_over_linear_equal_error"), 0.4, "takes 2.50 times as long as one in the space linear"),
        (("reconstruction", "test", "autoencoder", "max_mm"), 27.0, "up to 27.0 mm, against 4.01 mm"),
    ],
)
def test_each_cause_gives_its_own(path, value, expected):
    report = harmless_report()
    parent = report
    for key in path[:-1]:
        parent = parent[key]
    parent[path[-1]] = value
    (warning,) = warnings_of(report)
    assert expected in warning


def test_a_large_error_on_a_training_motion_is_no_held_out_warning():
    report = harmless_report()
    report["simulate"]["latent"][0]["online_error"]["relative"] = 0.5
    assert warnings_of(report) == []


def test_what_was_not_measured_gives_none():
    report = harmless_report()
    report["reconstruction"]["test"] = report["cubature"]["latent"] = None
    report["simulate"]["latent"][1]["online_error"] = None
    assert warnings_of(report) == []
