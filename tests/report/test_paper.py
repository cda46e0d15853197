"""The paper's table against what the paper says about it."""

from __future__ import annotations

import math

import pytest

from ldsim.report.paper import PAPER_TABLE_1, paper_row

# The ratios and their geometric mean.
RATIOS = {"beam": 1.28, "x": 1.13, "armadillo": 1.67, "dragon": 1.07, "elephant": 1.00}


@pytest.mark.parametrize("name", RATIOS)
def test_the_ratio_follows_from_the_two_times(name):
    assert paper_row(name).speedup == pytest.approx(RATIOS[name], abs=0.005)


def test_the_geometric_mean_of_the_ratios_is_the_stated_one():
    logs = [math.log(row.speedup) for row in PAPER_TABLE_1]
    assert math.exp(sum(logs) / len(logs)) == pytest.approx(1.21, abs=0.005)


def test_latent_spaces_are_smaller_than_their_linear_competitors_and_these_than_the_outer_space():
    assert all(row.r < row.kp <= row.k for row in PAPER_TABLE_1)


def test_an_unknown_object_has_no_row():
    assert paper_row("pendulum") is None
