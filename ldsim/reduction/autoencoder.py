"""Training of the autoencoder in PCA coordinates (paper, Sec. 4; loss of Eq. 7).

φ(z) = N(z) − N(0) and ψ(q) = E(q) − E(0), so that rest maps to rest both ways, exactly. Coordinates are scaled by one
number before training; after it, the latent space is turned and scaled so that JᵀM̃J is the identity on average over the
training poses. Lengths and forces in z then mean what they mean in q, and one stop rule serves both spaces.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.reduction.decoder import Decoder
from ldsim.reduction.encoder import Encoder

Array = NDArray[np.float64]

TORCH_ACTIVATIONS = {"elu": torch.nn.ELU, "relu": torch.nn.ReLU, "tanh": torch.nn.Tanh}


@dataclass(frozen=True)
class TrainingOptions:
    """How to train; the settings of the stage with their defaults are in `settings.TrainSettings`."""

    hidden: tuple[int, ...] = (100, 100)
    activation: str = "elu"
    epochs: int = 1500
    batch: int = 128
    learning_rate: float = 1e-3
    validation_share: float = 0.1
    patience: int = 400
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Trained:
    """A trained autoencoder.

    Attributes:
        decoder, encoder: φ and ψ in float64.
        loss: mean squared error in PCA coordinates after each epoch, (epochs, 2) float64 for training and validation.
        best_epoch: the epoch whose weights were kept.
    """

    decoder: Decoder
    encoder: Encoder
    loss: Array
    best_epoch: int


class Autoencoder(torch.nn.Module):
    """The pair of perceptrons, without scaling."""

    def __init__(self, k: int, r: int, options: TrainingOptions) -> None:
        super().__init__()
        self.encoder = _perceptron([k, *reversed(options.hidden), r], options.activation)
        self.decoder = _perceptron([r, *options.hidden, k], options.activation)
        self.register_buffer("zero_q", torch.zeros(1, k))
        self.register_buffer("zero_z", torch.zeros(1, r))

    def forward(self, q: torch.Tensor) -> torch.Tensor:
        z = self.encoder(q) - self.encoder(self.zero_q)
        decoded: torch.Tensor = self.decoder(z) - self.decoder(self.zero_z)
        return decoded


def _perceptron(sizes: list[int], activation: str) -> torch.nn.Sequential:
    modules: list[torch.nn.Module] = []
    for i in range(len(sizes) - 1):
        modules.append(torch.nn.Linear(sizes[i], sizes[i + 1]))
        if i < len(sizes) - 2:
            modules.append(TORCH_ACTIVATIONS[activation]())
    return torch.nn.Sequential(*modules)


@dataclass
class _Progress:
    """The best weights so far and the losses that led there."""

    loss: list[tuple[float, float]] = field(default_factory=list)
    best: float = float("inf")
    best_epoch: int = -1
    weights: dict[str, torch.Tensor] = field(default_factory=dict)

    def record(self, model: Autoencoder, training: float, validation: float) -> None:
        self.loss.append((training, validation))
        if validation < self.best:
            self.best, self.best_epoch = validation, len(self.loss) - 1
            self.weights = copy.deepcopy(model.state_dict())

    def stale(self, patience: int) -> bool:
        return len(self.loss) - 1 - self.best_epoch >= patience


def train(
    q: Array,
    r: int,
    options: TrainingOptions,
    progress: Callable[[int, float, float], None] | None = None,
) -> Trained:
    """Train an autoencoder of latent dimension r on coordinates q, (N, k) float64.

    Args:
        progress: called after each epoch with its number, training loss and validation loss (scaled).

    Raises:
        SolverError: r is not below k, there are too few snapshots to split, or the data do not move or the loss is
            not finite.
    """
    frames, k = q.shape
    if not 1 <= r <= k:
        raise SolverError(f"latent dimension r = {r}; allowed are 1 … k = {k}")
    held_back = max(int(round(options.validation_share * frames)), 1)
    if frames - held_back < 2:
        raise SolverError(f"{frames} training snapshots are too few to split into training and validation")
    if not np.isfinite(q).all():
        frame = int(np.argwhere(~np.isfinite(q))[0, 0])
        raise SolverError(f"training snapshot {frame} is not finite; rerun snapshot")
    scale = float(np.sqrt((q**2).mean(axis=0).max()))
    if not scale > 0:
        raise SolverError("the training snapshots do not move; there is nothing to learn")
    torch.manual_seed(options.seed)
    data = torch.tensor(q / scale, dtype=torch.float32)
    shuffled = torch.randperm(frames)
    held, kept = data[shuffled[:held_back]], data[shuffled[held_back:]]
    model = Autoencoder(k, r, options)
    state = _fit(model, kept, held, options, progress)
    model.load_state_dict(state.weights)
    decoder, encoder = _extract(model, scale, options.activation, q)
    return Trained(decoder, encoder, np.array(state.loss) * scale**2, state.best_epoch)


def _fit(
    model: Autoencoder,
    kept: torch.Tensor,
    held: torch.Tensor,
    options: TrainingOptions,
    progress: Callable[[int, float, float], None] | None,
) -> _Progress:
    """Adam with a cosine schedule; keeps the weights of the lowest validation loss and stops when it has gone stale."""
    optimiser = torch.optim.Adam(model.parameters(), lr=options.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, options.epochs, options.learning_rate * 1e-3)
    state = _Progress()
    for epoch in range(options.epochs):
        model.train()
        total = torch.zeros(())
        for batch in torch.split(torch.randperm(len(kept)), options.batch):
            optimiser.zero_grad(set_to_none=True)
            loss = ((model(kept[batch]) - kept[batch]) ** 2).sum() / len(batch)
            loss.backward()
            optimiser.step()
            total += loss.detach() * len(batch)
        schedule.step()
        model.eval()
        with torch.no_grad():
            validation = float(((model(held) - held) ** 2).sum() / len(held))
        training = float(total) / len(kept)
        if not np.isfinite(training):
            raise SolverError(f"the training loss is {training} in epoch {epoch}; lower train.learning_rate")
        state.record(model, training, validation)
        if progress is not None:
            progress(epoch, training, validation)
        if state.stale(options.patience):
            break
    return state


def _layers(perceptron: torch.nn.Module) -> tuple[list[Array], list[Array]]:
    """Weights (in, out) and biases (out,) of the linear layers, float64."""
    linear = [module for module in perceptron.modules() if isinstance(module, torch.nn.Linear)]
    weights = [layer.weight.detach().numpy().T.astype(np.float64) for layer in linear]
    return weights, [layer.bias.detach().numpy().astype(np.float64) for layer in linear]


def _extract(model: Autoencoder, scale: float, activation: str, q: Array) -> tuple[Decoder, Encoder]:
    """The networks in float64, scale folded in, and the latent space made orthonormal on average."""
    down, down_bias = _layers(model.encoder)
    up, up_bias = _layers(model.decoder)
    down[0] = down[0] / scale
    up[-1], up_bias[-1] = up[-1] * scale, up_bias[-1] * scale
    encoder = Encoder(tuple(down), tuple(down_bias), activation)
    decoder = Decoder.network(up, up_bias, activation)
    sample = encoder(q[:: max(len(q) // 200, 1)])
    metric = np.mean([J.T @ J for J in map(decoder.jacobian, sample)], axis=0)
    values, vectors = np.linalg.eigh(metric)
    root = vectors * np.sqrt(np.maximum(values, 1e-12 * values[-1]))
    inverse = np.linalg.inv(root)
    # z' = rootᵀ z, so the decoder reads z = root⁻ᵀ z' and the encoder writes rootᵀ z
    up[0] = inverse @ up[0]
    down[-1], down_bias[-1] = down[-1] @ root, down_bias[-1] @ root
    return Decoder.network(up, up_bias, activation), Encoder(tuple(down), tuple(down_bias), activation)
