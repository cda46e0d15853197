"""The paper's relations, evaluated on numbers made up so that the answer is known."""

from __future__ import annotations

import math

import pytest

from ldsim.optimise.solution import Reason, Solution
from reproduction.paper.convergence import Stopped, convergence_relations, stopped
from reproduction.paper.experiment import Relation
from reproduction.paper.sizes import _share_of_gain, grid_relations
from reproduction.paper.timing import table_relations
from reproduction.paper.training_modes import mode_relations, settled

# Figure 7 of the paper, raw, largest error in mm data of its authors, r 3 at every k "about 43".
PAPER_GRID = {6: {3: 43.0, 6: 34.7}, 10: {3: 43.0, 6: 18.8, 10: 16.1}, 20: {3: 43.0, 6: 15.4, 10: 11.8}}


def verdicts(relations: tuple[Relation, ...]) -> list[bool]:
    return [relation.holds for relation in relations]


@pytest.mark.parametrize(
    ("value", "goal", "holds"),
    [
        (1.0, "<= 1", True),
        (1.0, "< 1", False),
        (1.0, ">= 1", True),
        (1.0, "> 1", False),
        (2.0, "> 1", True),
        (None, "< 1", False),
        (math.nan, "< 1", False),
        (-math.inf, "< 1", False),
        (math.inf, ">= 1", False),
    ],
)
def test_a_relation_holds_when_its_finite_number_meets_the_goal(value: float | None, goal: str, holds: bool) -> None:
    assert Relation("some claim", value, goal).holds is holds


def test_a_number_that_is_not_finite_is_null_in_the_record() -> None:
    assert Relation("some claim", math.inf, "< 1").record()["value"] is None


# Figure 9 of the paper: iterations, evaluations and seconds.
PAPER_STOPS = {"latent": Stopped(46, 52, 0.563), "linear": Stopped(90, 109, 0.961), "full": Stopped(216, 611, 4.376)}


def test_the_papers_iterations_are_ordered_and_its_decoder_misses_the_floor() -> None:
    assert verdicts(convergence_relations(PAPER_STOPS, 4.3e-8)) == [True, True, True, False]
    slower = PAPER_STOPS | {"latent": Stopped(100, 110, 1.0)}
    assert verdicts(convergence_relations(slower, 1e-13)) == [False, True, False, True]


def test_a_space_that_does_not_come_to_the_stop_holds_nothing() -> None:
    never = PAPER_STOPS | {"latent": Stopped(math.nan, math.nan, math.nan)}
    assert verdicts(convergence_relations(never, 1e-13)) == [False, True, False, True]


@pytest.mark.parametrize("needed", [1, 2, 7, 20])
def test_the_stop_is_found_at_its_very_iteration(needed: int) -> None:
    def solve(most: int) -> Solution:
        done = min(most, 20)
        return Solution(1.0 if done < needed else 1e-7, 0.0, done, 2 * done, Reason.ITERATIONS_SPENT)

    found = stopped(solve, 1e-6, 20)
    assert (found.iterations, found.evaluations) == (needed, 2 * needed)
    assert math.isnan(stopped(solve, 1e-9, 20).iterations)


def test_the_papers_grid_falls_in_r_and_in_k() -> None:
    relations = grid_relations(PAPER_GRID, {6: 30.0, 10: 9.0, 20: 4.0})
    assert verdicts(relations) == [True, True, True, True]


def test_an_error_below_the_floor_of_pca_is_noticed() -> None:
    assert not grid_relations(PAPER_GRID, {6: 30.0, 10: 9.0, 20: 20.0})[0].holds


def test_an_error_that_goes_on_falling_is_no_saturation() -> None:
    falling = {20: {3: 43.0, 6: 40.0, 10: 1.0}}
    assert not grid_relations(falling, {20: 0.5})[3].holds


def test_the_share_of_the_gain_of_figure_six_is_the_papers() -> None:
    assert _share_of_gain([31.1, 20.2, 20.1, 17.1, 17.1, 17.5]) == pytest.approx(10.9 / 14.0)
    assert _share_of_gain([5.0, 6.0]) == 1.0


def test_the_papers_table_keeps_its_promise_and_a_slow_model_breaks_it() -> None:
    ratios = {"beam": 1.28, "x": 1.13, "armadillo": 1.67, "dragon": 1.07, "elephant": 1.0}
    dimensions = {"beam": (10, 23), "x": (6, 13), "armadillo": (20, 62), "dragon": (11, 25), "elephant": (7, 18)}
    *others, mean = table_relations(ratios, dimensions)
    assert all(verdicts(tuple(others)))
    assert mean.value == pytest.approx(1.21, abs=0.005)
    slow = table_relations(ratios | {"elephant": 0.5}, dimensions | {"x": (13, 13)})
    assert [relation.claim for relation in slow if not relation.holds] == [
        "r over kp, x",
        "linear step over latent step, elephant",
        "geometric mean of linear over latent step",
    ]


def test_the_papers_modes_keep_what_they_say_but_for_the_random_start() -> None:
    errors = {"random": 8.8e-7, "pca_trained": 5.6e-7, "pca_frozen": 6.1e-7, "pca_space": 4.1e-7}
    seconds = {"random": 473.0, "pca_trained": 461.0, "pca_frozen": 456.0, "pca_space": 195.0}
    pca = {5: 7.9e-6, 10: 5.1e-7}
    assert verdicts(mode_relations(errors, seconds, pca)) == [False, True, True]
    assert mode_relations(errors | {"random": 7e-7}, seconds, pca)[0].holds
    assert not mode_relations(errors | {"pca_space": 6e-7}, seconds, pca)[1].holds
    assert not mode_relations(errors, seconds | {"pca_frozen": 200.0}, pca)[2].holds


def test_the_error_that_a_training_ends_with_is_not_that_of_a_lucky_epoch() -> None:
    assert settled([*range(100, 5, -1), 5.0, 5.0, 0.1, 5.0, 9.0]) == 5.0
