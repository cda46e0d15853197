"""The search: it finds the intrinsic dimension of data that have one, within its budget of trainings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.learn.examples import Examples
from ldsim.learn.options import TrainOptions
from ldsim.learn.search import ORDERED_CODES, TRAININGS, Searched, search
from ldsim.learn.training import Trained, train, train_ordered
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder

Array = NDArray[np.float64]

OPTIONS = TrainOptions(
    kind="autoencoder", hidden=(24, 24), epochs=300, batch=32, learning_rate=5e-3, validation_share=0.1
)


def pendulum(frames: int = 200) -> Array:
    """A pendulum's swing in the plane of two of six coordinates, from rest: one number is enough."""
    angle = np.linspace(-1.2, 1.2, frames)
    flat = np.zeros(frames)
    return np.stack([np.sin(angle), 1 - np.cos(angle), 0.1 * np.sin(angle), flat, flat, flat], axis=1)


def double_pendulum(frames: int = 400) -> Array:
    """The ends of two rods, one hung on the other, at random angles: two numbers are enough."""
    first, second = np.random.default_rng(0).uniform(-0.8, 0.8, size=(2, frames))
    upper = np.stack([np.sin(first), 1 - np.cos(first)], axis=1)
    lower = upper + np.stack([np.sin(second), 1 - np.cos(second)], axis=1)
    return np.hstack([upper, lower, np.zeros((frames, 2))])


@pytest.mark.parametrize(("q", "dimension"), [(pendulum(), 1), (double_pendulum(), 2)])
def test_the_search_finds_the_intrinsic_dimension(q: Array, dimension: int) -> None:
    class Real:
        leading = staticmethod(train_ordered(Examples(q), 6, OPTIONS))

        def alone(self, r: int) -> Trained:
            return train(Examples(q), r, OPTIONS)

        def error(self, trained: Trained) -> tuple[float, float]:
            distance = np.linalg.norm(trained.decoder(trained.encoder(q)) - q, axis=1)
            return float(distance.max()), float(distance.mean())

    found = search(Real(), 6, None, tolerance=0.15)
    assert found.trained.decoder.r == dimension
    assert found.met
    assert Real().error(found.trained)[0] <= 0.15


class Counted:
    """Trainings that only note their size and meet the tolerance from given sizes on, alone and among ordered codes."""

    def __init__(self, k: int, alone: int, among: int) -> None:
        self.k, self.enough_alone, self.enough_among = k, alone, among
        self.trained: list[int] = []

    def make(self, r: int, own: bool) -> Trained:
        weights = [np.full((r, self.k), float(own))]
        return Trained(Decoder.network(weights, [np.zeros(self.k)]), Encoder((), ()), np.zeros((1, 2)), 0)

    def alone(self, r: int) -> Trained:
        self.trained.append(r)
        return self.make(r, own=True)

    def leading(self, r: int) -> Trained:
        return self.make(r, own=False)

    def error(self, trained: Trained) -> tuple[float, float]:
        own = bool(trained.decoder.weights[0].any())
        return float(trained.decoder.r < (self.enough_alone if own else self.enough_among)), 0.0

    def search(self, r: int | None = None) -> Searched:
        return search(self, self.k, r, tolerance=0.5)


@pytest.mark.parametrize("alone", range(6, 13))
@pytest.mark.parametrize("k", [12, 60])
def test_at_most_two_trainings_follow_the_ordered_one_and_the_result_holds(k: int, alone: int) -> None:
    trainings = Counted(k, alone=alone, among=9)
    found = trainings.search()
    assert found.met
    assert trainings.error(found.trained)[0] <= 0.5
    assert len(trainings.trained) <= TRAININGS
    assert found.trained.decoder.r == min(max(alone, 7), 9)


def test_the_table_tells_a_training_of_its_own_from_leading_codes() -> None:
    found = Counted(12, alone=8, among=9).search()
    table = [(each.r, each.largest, each.mean) for each in found.tried]
    assert table[-1] == (7, 1.0, 0.0)
    assert table[0] == (12, 0.0, 0.0)
    assert [each.own for each in found.tried] == [False, False, False, False, False, True, True]


def test_a_given_size_is_trained_once_and_says_whether_it_met_the_tolerance() -> None:
    trainings = Counted(12, alone=8, among=9)
    assert not trainings.search(5).met
    assert trainings.search(8).met
    assert trainings.trained == [5, 8]


@pytest.mark.parametrize("alone", [3, 6, 11, 18, 24])
def test_where_all_ordered_codes_miss_it_their_own_training_tells_which_size_to_train(alone: int) -> None:
    """Own errors are 1/r, those of the ordered codes ten times as large."""

    class Falling(Counted):
        def error(self, trained: Trained) -> tuple[float, float]:
            return (1.0 if trained.decoder.weights[0].any() else 10.0) / trained.decoder.r, 0.0

    trainings = Falling(60, alone, 61)
    found = search(trainings, 60, None, tolerance=1.0 / alone + 1e-9)
    assert found.trained.decoder.r == alone
    assert found.met
    assert len(trainings.trained) <= TRAININGS


def test_beyond_the_ordered_codes_sizes_grow_until_one_holds() -> None:
    trainings = Counted(60, alone=40, among=61)
    assert trainings.search().trained.decoder.r >= 40
    assert trainings.trained[0] == ORDERED_CODES


@pytest.mark.parametrize("k", [3, 40])
def test_a_tolerance_out_of_reach_is_said_in_one_line(k: int) -> None:
    with pytest.raises(SolverError, match=f"no latent dimension up to k = {k}"):
        Counted(k, alone=k + 1, among=k + 1).search()


def test_more_leading_codes_reconstruct_better() -> None:
    q = double_pendulum()
    leading: Callable[[int], Trained] = train_ordered(Examples(q), 4, OPTIONS)
    errors = [np.linalg.norm(t.decoder(t.encoder(q)) - q, axis=1).mean() for t in map(leading, (1, 2))]
    assert errors[1] < 0.6 * errors[0]
    assert leading(1).decoder.r == 1
