"""The stage `simulate`: where it warns that a motion is not like those that were learned from."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.dynamics.trajectory import Trajectory
from ldsim.pipeline.simulate import novel_frames
from ldsim.space.novelty import Novelty

NOVELTY = Novelty(np.zeros((1, 2)), 1.0, 2.0)


def run(scores: list[float], error: float | None) -> Trajectory:
    """A latent run whose mean displacement is 1 m."""
    none, ones = np.zeros(len(scores), dtype=np.int64), np.ones(len(scores))
    errors = {} if error is None else {"mean_error": error * ones, "mean_displacement": ones}
    return Trajectory(none, none, none, ones, novelty=np.array(scores), **errors)


@pytest.mark.parametrize("error, told", [(None, True), (np.inf, True), (np.nan, True), (0.11, True), (0.0011, False)])
def test_far_frames_are_told_of_unless_the_motion_is_known_to_be_good(error: float | None, told: bool) -> None:
    found = novel_frames({"a": run([1.0, 3.0, np.nan], error)}, NOVELTY)
    assert list(found) == ["a"] * told
    assert all(
        words.startswith("1 of 3 frames are far from the training motions (score up to 3") for words in found.values()
    )


def test_nothing_is_told_of_frames_that_are_near_or_where_no_score_is_known() -> None:
    assert novel_frames({"a": run([1.0, 2.0], 0.5)}, NOVELTY) == {}
    assert novel_frames({"a": run([1.0, 3.0], 0.5)}, None) == {}
