"""Training: what it must find, that it repeats, and that rest stays rest."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.learn.examples import Examples
from ldsim.learn.options import TrainOptions
from ldsim.learn.training import Trained, _repeated, train

Array = NDArray[np.float64]

OPTIONS = TrainOptions(
    kind="autoencoder",
    hidden=(24, 24),
    epochs=300,
    batch=32,
    learning_rate=5e-3,
    validation_share=0.1,
    recorded_share=0.0,
)


def arc(frames: int = 200) -> Array:
    """A pendulum's swing in the plane of two of four coordinates, from rest: one latent number is enough."""
    angle = np.linspace(-1.2, 1.2, frames)
    return np.stack([np.sin(angle), 1 - np.cos(angle), 0.1 * np.sin(angle), np.zeros(frames)], axis=1)


def mean_error(trained: Trained, q: Array) -> float:
    return float(np.linalg.norm(trained.decoder(trained.encoder(q)) - q, axis=1).mean())


def test_one_latent_coordinate_follows_a_pendulum_better_than_one_linear_one() -> None:
    q = arc()
    direction = np.linalg.svd(q, full_matrices=False)[2][:1]
    linear = np.linalg.norm(q - q @ direction.T @ direction, axis=1).mean()
    assert mean_error(train(Examples(q), 1, OPTIONS), q) < 0.1 * linear


def test_rest_maps_to_rest_both_ways() -> None:
    trained = train(Examples(arc()), 1, OPTIONS.replace(epochs=3))
    assert not trained.decoder(np.zeros(1)).any()
    assert not trained.encoder(np.zeros((1, 4))).any()


def test_the_same_seed_gives_the_same_weights_and_another_does_not() -> None:
    first, again, other = (train(Examples(arc()), 2, OPTIONS.replace(epochs=3, seed=seed)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.decoder.layers.weights, again.decoder.layers.weights)
    assert not np.array_equal(first.decoder.layers.weights, other.decoder.layers.weights)


def test_latent_lengths_are_outer_lengths_on_average() -> None:
    q = arc()
    trained = train(Examples(q), 2, OPTIONS.replace(epochs=40))
    z = trained.encoder(q)
    metric = np.mean([J.T @ J for J in map(trained.decoder.jacobian, z)], axis=0)
    np.testing.assert_allclose(metric, np.eye(2), atol=1e-6)


def test_the_weights_kept_are_those_of_the_least_validation_loss() -> None:
    trained = train(Examples(arc()), 1, OPTIONS.replace(epochs=60, learning_rate=0.05))
    assert trained.best_epoch == int(trained.loss[:, 1].argmin())


def test_training_stops_when_the_validation_loss_has_gone_stale() -> None:
    trained = train(Examples(arc()), 1, OPTIONS.replace(epochs=2000, learning_rate=0.05, patience=10))
    assert len(trained.loss) < 2000
    assert len(trained.loss) == trained.best_epoch + 11


def test_the_papers_training_is_adam_at_a_rate_that_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first step of Adam is as long as its rate in every weight, the second at most as long; none falls."""
    paper = OPTIONS.replace(optimiser="adam", schedule="fixed", learning_rate=1e-3, batch=1000, epochs=40, balance=0.0)
    rates, step = list[float](), torch.optim.Adam.step

    def watched(optimiser: torch.optim.Adam) -> None:
        (group,) = optimiser.param_groups
        before = [parameter.detach().clone() for parameter in group["params"]]
        step(optimiser)
        moved = max(float((a.detach() - b).abs().max()) for a, b in zip(group["params"], before, strict=True))
        rates.append(group["lr"] if rates else moved)

    monkeypatch.setattr(torch.optim.Adam, "step", watched)
    found = train(Examples(arc()), 1, paper)
    assert rates == pytest.approx([1e-3] * 40, rel=1e-2)
    assert found.loss[-1, 0] < found.loss[0, 0]


@pytest.mark.parametrize(
    ("q", "r", "message"),
    [
        (arc(), 5, "latent dimension r = 5; allowed are 1 … k = 4"),
        (arc(), 0, "latent dimension r = 0"),
        (arc()[:2], 1, "too few to split"),
        (np.zeros((50, 4)), 1, "do not move"),
        (np.where(np.arange(200)[:, None] == 7, np.nan, arc()), 1, "not finite"),
    ],
)
def test_what_cannot_be_trained_is_refused_in_one_line(q: Array, r: int, message: str) -> None:
    with pytest.raises(SolverError, match=message):
        train(Examples(q), r, OPTIONS.replace(epochs=2))


@pytest.mark.parametrize(("recorded", "share", "times"), [(10, 0.5, 9), (10, 0.25, 3), (10, 0.0, 1), (100, 0.5, 1)])
def test_recorded_frames_are_repeated_to_their_share(recorded: int, share: float, times: int) -> None:
    found = np.bincount(_repeated(torch.arange(100), recorded, share).numpy())
    assert (found[:recorded] == times).all()
    assert (found[recorded:] == 1).all()


def test_frames_that_are_repeated_are_learned_better() -> None:
    q = arc()
    examples = Examples(q, synthetic=len(q) - len(q) // 8)
    often = train(examples, 1, OPTIONS.replace(epochs=40, recorded_share=0.9))
    alike = train(examples, 1, OPTIONS.replace(epochs=40))
    own = q[: len(q) // 8]
    assert mean_error(often, own) < 0.8 * mean_error(alike, own)
