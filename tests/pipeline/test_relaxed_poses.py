"""Which poses a condensed space learns from."""

from __future__ import annotations

import numpy as np

from ldsim.pipeline.relaxed_poses import farthest_points


def test_poses_are_taken_from_the_outside_in_and_each_once() -> None:
    y = np.array([[0.0], [0.1], [-3.0], [1.0], [5.0], [4.7]])
    # 5 is the farthest from rest, which needs no sample; −3 from both, then 1, and 4.7 before 0.1
    assert farthest_points(y, 4).tolist() == [4, 2, 3, 5]
    assert sorted(farthest_points(y, 6).tolist()) == [0, 1, 2, 3, 4, 5]


def test_poses_are_taken_far_from_what_is_relaxed_already() -> None:
    y = np.array([[5.0], [4.0], [-1.0], [2.0]])
    assert farthest_points(y, 2, beside=np.array([[4.9]])).tolist() == [3, 2]


def test_who_asks_for_more_poses_gets_those_of_before_first() -> None:
    y = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_array_equal(farthest_points(y, 30)[:20], farthest_points(y, 20))


def test_a_motion_that_stands_still_gives_each_frame_once_at_most() -> None:
    assert len(set(farthest_points(np.zeros((5, 2)), 3).tolist())) == 3
