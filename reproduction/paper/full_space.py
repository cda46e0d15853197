"""The training modes of the paper's Figure 5 that work on displacements: outer layers and a loss in the full space.

u → D u → autoencoder → U q, with D (k, 3n) and U (3n, k) linear layers. They start at random or at the PCA, and are
trained or frozen. The fourth mode, the loss in PCA coordinates, is `training.train`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.errors import SolverError
from ldsim.learn.network import Autoencoder, extract
from ldsim.learn.options import TrainOptions
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder

MODES = ("random", "pca_trained", "pca_frozen")


@dataclass(frozen=True, eq=False)
class FullSpaceTrained:
    """An autoencoder with outer layers of its own.

    Attributes:
        U: (3n, k) float64, UᵀU = I; the columns span what the outer layer does.
        decoder, encoder: φ and ψ in the coordinates of U.
        loss: mean squared error of u after each epoch, summed over the degrees of freedom, (epochs,) m².
    """

    U: Array
    decoder: Decoder
    encoder: Encoder
    loss: Array


def train_full_space(u: NDArray[np.float32], U: Array, r: int, options: TrainOptions, mode: str) -> FullSpaceTrained:
    """Train with the loss ‖û − u‖² in the full space (paper, Sec. 4.2), by Adam at a fixed rate.

    Args:
        u: displacements, (N, 3n), metres.
        U: PCA basis with UᵀU = I, (3n, k); gives k in every mode, and the start of the outer layers but for "random".
        mode: one of `MODES`.

    Raises:
        SolverError: the mode is unknown, r is above k, or the loss is not finite.
    """
    k = U.shape[1]
    if mode not in MODES:
        raise SolverError(f"training mode {mode!r} is unknown; known are {', '.join(MODES)}")
    if not 1 <= r <= k:
        raise SolverError(f"latent dimension r = {r}; allowed are 1 … k = {k}")
    q = u @ U
    scale = float(np.sqrt((q**2).mean(axis=0).max()))
    if not scale > 0:
        raise SolverError("the training snapshots do not move; there is nothing to learn")
    data = torch.tensor(u / scale, dtype=torch.float32)
    with torch.random.fork_rng():
        torch.manual_seed(options.seed)
        # as `train` has it; from a random start the outer layers' coordinates are not the basis' ones
        spread = np.sqrt((q**2).mean(axis=0)) / scale
        model = Autoencoder(
            r, torch.ones(k) if mode == "random" else torch.tensor(spread, dtype=torch.float32), options
        )
        down, up = torch.nn.Linear(len(U), k, bias=False), torch.nn.Linear(k, len(U), bias=False)
    if mode != "random":
        with torch.no_grad():
            down.weight.copy_(torch.tensor(U.T))
            up.weight.copy_(torch.tensor(U))
    for layer in (down, up):
        layer.weight.requires_grad_(mode != "pca_frozen")
    loss = _fit(data, model, down, up, options)
    return _result(model, down, up, q, scale, loss)


def _fit(
    data: torch.Tensor, model: Autoencoder, down: torch.nn.Linear, up: torch.nn.Linear, options: TrainOptions
) -> list[float]:
    """Adam at the rate of the options; the loss of each epoch, scaled."""
    generator = torch.Generator().manual_seed(options.seed)
    free = [p for part in (model, down, up) for p in part.parameters() if p.requires_grad]
    optimiser = torch.optim.Adam(free, lr=options.learning_rate)
    losses: list[float] = []
    for epoch in range(options.epochs):
        total = 0.0
        for batch in torch.split(torch.randperm(len(data), generator=generator), options.batch):
            optimiser.zero_grad(set_to_none=True)
            error = up(model(down(data[batch]))) - data[batch]
            loss = error.square().sum() / len(batch)
            loss.backward()
            optimiser.step()
            total += float(loss.detach()) * len(batch)
        losses.append(total / len(data))
        if not math.isfinite(losses[-1]):
            raise SolverError(f"the training loss is {losses[-1]} in epoch {epoch}; lower train.learning_rate")
    return losses


def _result(
    model: Autoencoder, down: torch.nn.Linear, up: torch.nn.Linear, q: Array, scale: float, loss: list[float]
) -> FullSpaceTrained:
    """Orthonormal outer layer: U R = up, so the decoder ends in R and the encoder begins with down U."""
    outer, inner = (layer.weight.detach().numpy().astype(np.float64) for layer in (up, down))
    Q, R = np.linalg.qr(outer)
    decoder, encoder = extract(model, scale, np.asarray(q, dtype=np.float64), model.r)
    up_weights, up_biases = [*decoder.weights], [*decoder.biases]
    up_weights[-1], up_biases[-1] = up_weights[-1] @ R.T, up_biases[-1] @ R.T
    down_weights = [(inner @ Q).T @ encoder.weights[0], *encoder.weights[1:]]
    return FullSpaceTrained(
        Q,
        Decoder.network(up_weights, up_biases, model.activation),
        Encoder(tuple(down_weights), encoder.biases, model.activation),
        np.array(loss) * scale**2,
    )
