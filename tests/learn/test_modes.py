"""Every way to train: exact rest, the adjoint, the seed, and that what is extracted is what was trained."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.learn.examples import Examples, PoseForces
from ldsim.learn.losses import equilibrium_shift, projectors
from ldsim.learn.network import Autoencoder, extract
from ldsim.learn.options import TrainOptions
from ldsim.learn.training import train

Array = NDArray[np.float64]

K, R = 6, 2
SHORT = TrainOptions(
    kind="autoencoder",
    hidden=(12, 12),
    epochs=20,
    batch=32,
    learning_rate=5e-3,
    balance=0.0,
    validation_share=0.1,
    recorded_share=0.0,
)
TERMS = {"denoising": {"noise": 0.05}, "variational": {"weight": 1e-4}}
EQUILIBRIUM = {"equilibrium": {"weight": 1.0, "start": 0.5}}
MODES = {
    "plain": SHORT,
    "balanced": SHORT.replace(balance=0.5),
    **{name: SHORT.replace(**{name: value}) for name, value in TERMS.items()},
    "equilibrium": SHORT.replace(**EQUILIBRIUM),
    "all at once": SHORT.replace(**TERMS, **EQUILIBRIUM),
    **{activation: SHORT.replace(activation=activation) for activation in ("relu", "tanh", "sigmoid")},
    "one layer": SHORT.replace(hidden=(20,)),
    "four layers": SHORT.replace(hidden=(8, 8, 8, 8)),
}
# No configuration can ask for a network without hidden layers; here its answers are known.
LINEAR = SHORT.model_copy(update={"hidden": ()})


def swing(frames: int = 200) -> Array:
    """A curved surface of two numbers in six coordinates of falling size."""
    a, b = np.random.default_rng(0).uniform(-1, 1, size=(2, frames))
    return np.stack([a, 0.5 * b, 0.2 * a * a, 0.1 * a * b, 0.02 * b * b, 1e-3 * a**3], axis=1)


def forces(q: Array) -> PoseForces:
    """Stiffnesses of very different sizes that turn with the pose."""
    stiffness = np.empty((10, K, K))
    for i in range(10):
        turn = np.linalg.qr(np.random.default_rng(i).normal(size=(K, K)))[0]
        stiffness[i] = turn @ np.diag(10.0 ** np.arange(K)) @ turn.T
    return PoseForces(np.arange(0, 200, 20), stiffness, 0.01 * np.random.default_rng(1).normal(size=(10, K)))


def examples(q: Array) -> Examples:
    return Examples(q, forces=forces(q))


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_maps_rest_to_rest_and_has_its_adjoint(mode: str) -> None:
    q = swing()
    trained = train(examples(q), R, MODES[mode])
    assert not trained.decoder(np.zeros(R)).any()
    assert not trained.encoder(np.zeros((1, K))).any()
    rng = np.random.default_rng(2)
    z, d, v = rng.normal(size=R), rng.normal(size=R), rng.normal(size=K)
    assert v @ (trained.decoder.jacobian(z) @ d) == pytest.approx(trained.decoder.vjp(z, v) @ d, rel=1e-10)


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_repeats_with_its_seed(mode: str) -> None:
    q = swing()
    first, again = (train(examples(q), R, MODES[mode].replace(epochs=4)) for _ in range(2))
    np.testing.assert_array_equal(first.decoder.layers.weights, again.decoder.layers.weights)


class Memory:
    """A checkpoint that is kept in memory."""

    def __init__(self) -> None:
        self.arrays: Mapping[str, NDArray[np.generic]] | None = None

    def load(self) -> Mapping[str, NDArray[np.generic]] | None:
        return self.arrays

    def save(self, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        self.arrays = {name: np.copy(values) for name, values in arrays.items()}


@pytest.mark.parametrize("mode", ["plain", "all at once"])
@pytest.mark.parametrize("stop", [51, 99, 100, 117])
def test_an_interrupted_and_resumed_training_repeats_an_undisturbed_one(mode: str, stop: int) -> None:
    q, options, checkpoint = swing(), MODES[mode].replace(epochs=120), Memory()

    def interrupt(epoch: int, training: float, validation: float) -> None:
        if epoch == stop:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(examples(q), R, options, interrupt, checkpoint)
    epochs: list[int] = []
    resumed = train(examples(q), R, options, lambda epoch, *_: epochs.append(epoch), checkpoint)
    undisturbed = train(examples(q), R, options)
    assert epochs[0] == stop // 50 * 50
    np.testing.assert_array_equal(resumed.decoder.layers.weights, undisturbed.decoder.layers.weights)
    np.testing.assert_array_equal(resumed.loss, undisturbed.loss)


def model() -> Autoencoder:
    torch.manual_seed(3)
    spread = torch.tensor([1.0, 0.5, 0.2, 0.1, 0.05, 0.01])
    return Autoencoder(R, spread, SHORT)


def test_what_is_extracted_is_what_was_trained() -> None:
    q, network = swing(), model()
    decoder, encoder = extract(network, 0.7, q, R)
    with torch.no_grad():
        expected = 0.7 * network(torch.tensor(q / 0.7, dtype=torch.float32)).numpy()
    np.testing.assert_allclose(decoder(encoder(q)), expected, atol=1e-6)


def test_the_jacobian_of_the_network_is_its_derivative() -> None:
    network = model().double()
    z = torch.randn(3, R, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    expected = torch.stack([torch.autograd.functional.jacobian(lambda x: network.decode(x[None])[0], row) for row in z])
    torch.testing.assert_close(network.jacobian(z), expected)


def test_the_equilibrium_shift_is_how_far_the_energy_minimum_moves_along_the_manifold() -> None:
    """On a quadratic energy and a linear decoder: the minimiser over z, less the code, by plain algebra."""
    q, given, network = swing(), forces(swing()), Autoencoder(R, torch.ones(K), LINEAR).double()
    poses = torch.tensor(q[given.frames])
    along = projectors(network, poses, torch.tensor(given.stiffness), torch.tensor(given.excess))
    loss = float(equilibrium_shift(network, along, torch.arange(10)).detach())
    with torch.no_grad():
        codes, J = network.encode(poses).numpy(), network.jacobian(torch.zeros(1, R).double())[0].numpy()
    squares = []
    for i, frame in enumerate(given.frames):
        K_i = given.stiffness[i]
        # minimise ½ (J z − q)ᵀ K (J z − q) + excess·J z
        best = np.linalg.solve(J.T @ K_i @ J, J.T @ (K_i @ q[frame] - given.excess[i]))
        squares.append(np.sum((J @ (best - codes[i])) ** 2))
    assert loss == pytest.approx(np.mean(squares), rel=1e-3)


def test_the_equilibrium_loss_lowers_the_shift() -> None:
    q, given = swing(), forces(swing())
    options = SHORT.replace(epochs=150)

    def shift(trained_options: TrainOptions) -> float:
        trained = train(Examples(q, forces=given), R, trained_options)
        total = 0.0
        for i, frame in enumerate(given.frames):
            z = trained.encoder(q[frame : frame + 1])[0]
            J, K_i = trained.decoder.jacobian(z), given.stiffness[i]
            force = K_i @ (trained.decoder(z) - q[frame]) + given.excess[i]
            total += float(np.linalg.norm(J @ np.linalg.solve(J.T @ K_i @ J, J.T @ force)))
        return total

    assert shift(options.replace(equilibrium={"weight": 3.0, "start": 0.2})) < 0.8 * shift(options)


def test_an_equilibrium_loss_without_forces_is_refused() -> None:
    with pytest.raises(SolverError, match="needs the forces"):
        train(Examples(swing()), R, SHORT.replace(**EQUILIBRIUM))


@pytest.mark.skipif(torch.cuda.is_available(), reason="has a graphics card")
def test_a_graphics_card_that_is_not_there_is_refused() -> None:
    with pytest.raises(SolverError, match="sees no CUDA device; use auto or cpu"):
        train(Examples(swing()), R, SHORT.replace(device="cuda"))
