"""Every way to train: exact rest, the adjoint, the seed, and that what is extracted is what was trained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.learn import Forces, TrainingOptions, train, train_full_space
from ldsim.learn.full_space import MODES as FULL_SPACE_MODES
from ldsim.learn.losses import curvature, equilibrium_shift, projectors
from ldsim.learn.network import Autoencoder, extract

Array = NDArray[np.float64]

K, R = 6, 2
SHORT = TrainingOptions(hidden=(12, 12), epochs=20, batch=32, learning_rate=5e-3, patience=300, balance=0.0)
MODES = {
    "plain": SHORT,
    "balanced": replace(SHORT, balance=0.5),
    "skip": replace(SHORT, skip=True),
    "denoising": replace(SHORT, noise=0.05),
    "variational": replace(SHORT, variational=1e-4),
    "smooth": replace(SHORT, smoothness=0.1),
    "equilibrium": replace(SHORT, equilibrium=1.0),
    "all at once": replace(SHORT, skip=True, noise=0.05, variational=1e-4, smoothness=0.1, equilibrium=1.0),
    **{activation: replace(SHORT, activation=activation) for activation in ("relu", "tanh", "sigmoid")},
    "one layer": replace(SHORT, hidden=(20,)),
    "four layers": replace(SHORT, hidden=(8, 8, 8, 8)),
}


def swing(frames: int = 200) -> Array:
    """A curved surface of two numbers in six coordinates of falling size."""
    a, b = np.random.default_rng(0).uniform(-1, 1, size=(2, frames))
    return np.stack([a, 0.5 * b, 0.2 * a * a, 0.1 * a * b, 0.02 * b * b, 1e-3 * a**3], axis=1)


def forces(q: Array) -> Forces:
    """Stiffnesses of very different sizes that turn with the pose."""
    stiffness = np.empty((10, K, K))
    for i in range(10):
        turn = np.linalg.qr(np.random.default_rng(i).normal(size=(K, K)))[0]
        stiffness[i] = turn @ np.diag(10.0 ** np.arange(K)) @ turn.T
    return Forces(np.arange(0, 200, 20), stiffness, 0.01 * np.random.default_rng(1).normal(size=(10, K)))


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_maps_rest_to_rest_and_has_its_adjoint(mode: str) -> None:
    q = swing()
    trained = train(q, R, MODES[mode], forces=forces(q))
    assert not trained.decoder(np.zeros(R)).any()
    assert not trained.encoder(np.zeros((1, K))).any()
    rng = np.random.default_rng(2)
    z, d, v = rng.normal(size=R), rng.normal(size=R), rng.normal(size=K)
    assert v @ (trained.decoder.jacobian(z) @ d) == pytest.approx(trained.decoder.vjp(z, v) @ d, rel=1e-10)


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_repeats_with_its_seed(mode: str) -> None:
    q = swing()
    first, again = (train(q, R, replace(MODES[mode], epochs=4), forces=forces(q)) for _ in range(2))
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
    q, options, checkpoint = swing(), replace(MODES[mode], epochs=120), Memory()

    def interrupt(epoch: int, training: float, validation: float) -> None:
        if epoch == stop:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(q, R, options, interrupt, forces(q), checkpoint)
    epochs: list[int] = []
    resumed = train(q, R, options, lambda epoch, *_: epochs.append(epoch), forces(q), checkpoint)
    undisturbed = train(q, R, options, forces=forces(q))
    assert epochs[0] == stop // 50 * 50
    np.testing.assert_array_equal(resumed.decoder.layers.weights, undisturbed.decoder.layers.weights)
    np.testing.assert_array_equal(resumed.loss, undisturbed.loss)


def model(skip: bool = False) -> Autoencoder:
    torch.manual_seed(3)
    spread = torch.tensor([1.0, 0.5, 0.2, 0.1, 0.05, 0.01])
    return Autoencoder(R, spread, replace(SHORT, skip=skip))


@pytest.mark.parametrize("skip", [False, True])
def test_what_is_extracted_is_what_was_trained(skip: bool) -> None:
    q, network = swing(), model(skip)
    decoder, encoder = extract(network, 0.7, q, R)
    with torch.no_grad():
        expected = 0.7 * network(torch.tensor(q / 0.7, dtype=torch.float32)).numpy()
    np.testing.assert_allclose(decoder(encoder(q)), expected, atol=1e-6)


@pytest.mark.parametrize("skip", [False, True])
def test_the_jacobian_of_the_network_is_its_derivative(skip: bool) -> None:
    network = model(skip).double()
    z = torch.randn(3, R, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    expected = torch.stack([torch.autograd.functional.jacobian(lambda x: network.decode(x[None])[0], row) for row in z])
    torch.testing.assert_close(network.jacobian(z), expected)


def test_a_linear_decoder_has_no_curvature() -> None:
    network = Autoencoder(R, torch.ones(K), replace(SHORT, hidden=()))
    z = torch.randn(8, R, generator=torch.Generator().manual_seed(0))
    assert curvature(network, z, torch.Generator().manual_seed(1)).item() < 1e-12


def test_the_equilibrium_shift_is_how_far_the_energy_minimum_moves_along_the_manifold() -> None:
    """On a quadratic energy and a linear decoder: the minimiser over z, less the code, by plain algebra."""
    q, given, network = swing(), forces(swing()), Autoencoder(R, torch.ones(K), replace(SHORT, hidden=())).double()
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
    options = replace(SHORT, epochs=150)

    def shift(trained_options: TrainingOptions) -> float:
        trained = train(q, R, trained_options, forces=given)
        total = 0.0
        for i, frame in enumerate(given.frames):
            z = trained.encoder(q[frame : frame + 1])[0]
            J, K_i = trained.decoder.jacobian(z), given.stiffness[i]
            force = K_i @ (trained.decoder(z) - q[frame]) + given.excess[i]
            total += float(np.linalg.norm(J @ np.linalg.solve(J.T @ K_i @ J, J.T @ force)))
        return total

    assert shift(replace(options, equilibrium=3.0, equilibrium_start=0.2)) < 0.8 * shift(options)


def test_an_equilibrium_loss_without_forces_is_refused() -> None:
    with pytest.raises(SolverError, match="needs the forces"):
        train(swing(), R, replace(SHORT, equilibrium=1.0))


@pytest.mark.skipif(torch.cuda.is_available(), reason="has a graphics card")
def test_a_graphics_card_that_is_not_there_is_refused() -> None:
    with pytest.raises(SolverError, match="sees no CUDA device; use auto or cpu"):
        train(swing(), R, replace(SHORT, device="cuda"))


# Figure 5


def displacements() -> tuple[NDArray[np.float32], Array]:
    """A curved motion of 30 degrees of freedom, and its PCA of six modes."""
    modes = np.linalg.qr(np.random.default_rng(4).normal(size=(30, K)))[0]
    u = swing() @ modes.T
    return u.astype(np.float32), np.ascontiguousarray(np.linalg.svd(u, full_matrices=False)[2][:K].T)


@pytest.mark.parametrize("mode", FULL_SPACE_MODES)
def test_full_space_training_beats_as_many_linear_modes_and_keeps_rest(mode: str) -> None:
    u, U = displacements()
    trained = train_full_space(u, U, R, replace(SHORT, epochs=250), mode)
    np.testing.assert_allclose(trained.U.T @ trained.U, np.eye(K), atol=1e-10)
    decoded = trained.decoder(trained.encoder(u @ trained.U)) @ trained.U.T
    linear = np.square(u - u @ U[:, :R] @ U[:, :R].T).sum(axis=1).mean()
    if mode != "random":
        assert np.square(u - decoded).sum(axis=1).mean() < 0.5 * linear
        assert np.square(u - decoded).sum(axis=1).mean() == pytest.approx(trained.loss[-1], rel=0.3)
    assert trained.loss[-1] < 0.1 * trained.loss[0]
    assert not trained.decoder(np.zeros(R)).any()


def test_frozen_outer_layers_stay_where_the_pca_put_them() -> None:
    u, U = displacements()
    trained = train_full_space(u, U, R, SHORT, "pca_frozen")
    np.testing.assert_allclose(trained.U @ trained.U.T, U @ U.T, atol=1e-6)


def test_an_unknown_mode_is_refused() -> None:
    with pytest.raises(SolverError, match="known are random, pca_trained, pca_frozen"):
        train_full_space(*displacements(), R, SHORT, "pca")
