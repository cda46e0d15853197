"""Novelty: near the training codes it is low, far from them high, and its threshold comes from held-out poses."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.novelty import MEMORY, Novelty, fit_novelty, remembered

Array = NDArray[np.float64]

MATRIX = np.linalg.qr(np.random.default_rng(0).normal(size=(6, 2)))[0]


def plane() -> tuple[Decoder, Encoder]:
    """Two codes of six coordinates, linear both ways."""
    return Decoder.network([MATRIX.T.copy()], [np.zeros(6)]), Encoder((MATRIX.copy(),), (np.zeros(2),))


def ring(radius: float, count: int, seed: int = 0) -> Array:
    angle = np.random.default_rng(seed).uniform(0, 2 * np.pi, count)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_training_codes_score_at_most_one_but_for_a_hundredth() -> None:
    z = np.random.default_rng(1).normal(size=(2000, 2)) * [1.0, 1e-2]
    novelty = fit_novelty(*plane(), z @ MATRIX.T, np.empty((0, 6)))
    assert (novelty(z) <= 1).mean() == pytest.approx(0.99, abs=0.002)
    assert novelty.threshold == 2.0


def test_the_score_is_the_distance_to_the_nearest_landmark() -> None:
    rng = np.random.default_rng(2)
    novelty, z = Novelty(rng.normal(size=(30, 3)), 2.5, 1.0), rng.normal(size=(8, 3))
    distances = np.linalg.norm(z[:, None] - novelty.landmarks[None], axis=2)
    np.testing.assert_allclose(novelty(z), distances.min(axis=1) / 2.5, rtol=1e-12)


def test_rest_and_training_codes_are_trusted_and_what_lies_beyond_is_not() -> None:
    z = ring(1.0, 3000)
    novelty = fit_novelty(*plane(), z @ MATRIX.T, np.empty((0, 6)))
    assert novelty(np.zeros((1, 2)))[0] == 0.0
    assert novelty(z).max() < 3
    assert novelty(ring(2.0, 20)).min() > novelty.threshold


def test_the_threshold_tells_badly_decoded_held_out_poses_from_good_ones() -> None:
    rng = np.random.default_rng(3)
    z = rng.normal(size=(500, 2))
    noise = 1e-3 * rng.normal(size=(500, 6))
    good, far = rng.normal(size=(100, 2)), ring(30.0, 100)
    off = 0.1 * np.linalg.svd(MATRIX)[0][:, 5]
    unseen = np.vstack([good @ MATRIX.T, far @ MATRIX.T + off])
    novelty = fit_novelty(*plane(), z @ MATRIX.T + noise, unseen)
    assert novelty(good).max() < novelty.threshold <= novelty(far).min()


def test_codes_like_the_training_ones_are_not_warned_of_even_where_near_poses_are_badly_decoded() -> None:
    rng = np.random.default_rng(3)
    z = rng.normal(size=(500, 2))
    noise = 1e-3 * rng.normal(size=(500, 6))
    off = 0.1 * np.linalg.svd(MATRIX)[0][:, 5]
    unseen = np.vstack([z[:50] @ MATRIX.T, rng.normal(size=(50, 2)) @ MATRIX.T + off])
    novelty = fit_novelty(*plane(), z @ MATRIX.T + noise, unseen)
    assert novelty.threshold == 1.0
    assert (novelty(z) > novelty.threshold).mean() < 0.02


@pytest.mark.parametrize(("times", "told"), [(1.9, False), (2.1, True)])
def test_a_pose_is_badly_decoded_from_twice_the_usual_error_on(times: float, told: bool) -> None:
    rng, usual = np.random.default_rng(3), 1e-3 * np.linalg.svd(MATRIX)[0][:, 5]
    good, far = rng.normal(size=(50, 2)), ring(30.0, 50)
    unseen = np.vstack([good @ MATRIX.T + usual, far @ MATRIX.T + times * usual])
    novelty = fit_novelty(*plane(), rng.normal(size=(300, 2)) @ MATRIX.T + usual, unseen)
    assert (novelty.threshold != 2.0) == told


def test_a_code_that_is_not_finite_has_no_score() -> None:
    novelty = Novelty(np.zeros((1, 2)), 1.0, 1.0)
    assert np.isnan(novelty(np.array([[np.nan, 0.0]]))).all()


def test_few_training_codes_still_have_a_scale() -> None:
    z = np.random.default_rng(4).normal(size=(40, 2))
    novelty = fit_novelty(*plane(), z @ MATRIX.T, np.empty((0, 6)))
    assert 0.5 < novelty(z).max() < 3


@pytest.mark.parametrize("time_step", [0.001, 0.01])
def test_the_memory_of_a_score_follows_it_within_half_a_second(time_step: float) -> None:
    away = np.ones(round(MEMORY / time_step))
    memory = remembered(np.concatenate([away, 0 * away]), time_step)
    assert memory[len(away) - 1] == pytest.approx(1 - np.exp(-1), rel=1e-9)
    assert memory[-1] == pytest.approx(memory[len(away) - 1] * np.exp(-1), rel=1e-9)
    assert (np.diff(memory[: len(away)]) > 0).all()
    assert (np.diff(memory[len(away) :]) < 0).all()


def test_the_memory_of_a_run_that_is_lost_ends_where_the_run_does() -> None:
    memory = remembered(np.array([1.0, 2.0, np.nan, np.nan]), 0.1)
    assert np.isfinite(memory).tolist() == [True, True, False, False]
