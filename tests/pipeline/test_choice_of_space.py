"""Which space to use, and what is as good as the latent one: on runs whose errors and times are given."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.dynamics.trajectory import Trajectory
from ldsim.optimise.solution import Reason
from ldsim.pipeline.choice_of_space import Standing, chosen_space, equal_error, judging, standings

ROLES = {"a": "train", "b": "validation", "c": "validation", "d": "test"}


def trajectory(error: float, seconds: float, frames: int = 4, lost: bool = False) -> Trajectory:
    counts = np.zeros(frames, dtype=np.int64)
    reason = np.full(frames, int(Reason.INFINITE_START)) if lost else counts
    moved = np.arange(1.0, frames + 1)
    return Trajectory(
        counts, counts, reason, np.full(frames, seconds), mean_error=error * moved, mean_displacement=moved
    )


def test_an_error_is_over_all_frames_of_all_motions_and_a_time_the_median_of_all_steps() -> None:
    runs = {"latent": {"a": trajectory(0.5, 1.0, 2), "b": trajectory(0.1, 2.0, 6)}}
    (found,) = standings(runs, ["a", "b"])
    assert found.error == pytest.approx((0.5 * 3 + 0.1 * 21) / 24)
    assert found.seconds == 2.0


def test_a_space_that_was_lost_is_infinitely_far_off_and_one_that_ran_less_is_left_out() -> None:
    runs = {
        "full": {"a": trajectory(0.0, 9.0)},
        "latent": {"a": trajectory(0.1, 1.0, lost=True), "b": trajectory(0.1, 1.0)},
        "linear": {"a": trajectory(0.1, 1.0)},
    }
    (found,) = standings(runs, ["a", "b"])
    assert (found.space, found.error) == ("latent", np.inf)
    assert standings(runs, []) == []


def test_without_full_space_runs_nothing_is_known() -> None:
    blind = Trajectory(*(np.zeros(3, dtype=np.int64) for _ in range(3)), np.ones(3))
    assert standings({"latent": {"a": blind}}, ["a"]) == []
    assert chosen_space([]) == "latent"


@pytest.mark.parametrize(
    ("order", "expected"),
    [(("test", "validation"), ["d"]), (("validation", "train"), ["b", "c"]), (("train",), ["a"]), ((), [])],
)
def test_the_first_role_that_a_motion_has_judges(order: tuple[str, ...], expected: list[str]) -> None:
    assert judging(ROLES, order) == expected


def test_the_fastest_of_the_nearly_best_is_chosen() -> None:
    found = [Standing("latent", 0.1, 2.0), Standing("linear", 0.149, 1.0), Standing("linear_9", 0.2, 0.1)]
    assert chosen_space(found) == "linear"
    assert chosen_space([found[0], found[2]]) == "latent"
    assert chosen_space([Standing("linear", np.inf, 0.1), found[0]]) == "latent"


def test_equal_error_is_the_fastest_linear_space_that_is_at_least_as_good() -> None:
    latent = Standing("latent", 0.1, 2.0)
    small, enough, large = (
        Standing("linear_5", 0.2, 0.5),
        Standing("linear", 0.1, 1.0),
        Standing("linear_20", 0.05, 3.0),
    )
    assert equal_error([latent, large, small, enough]) == (latent, enough, large)
    assert equal_error([latent, small]) == (latent, None, small)
    lost = Standing("latent", np.inf, 2.0)
    assert equal_error([lost, small]) == (lost, None, small)
