"""What training is told and what it returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrainingOptions:
    """How to train; the settings of the stage with their defaults are in `settings.TrainSettings`.

    Attributes:
        hidden: widths of the hidden layers of the decoder; the encoder has them in reverse.
        balance: the loss weights each coordinate by its root mean square to the power −balance: 0 is Eq. 7, 1 gives
            all the same weight. Small coordinates are stiff ones, and forces hang on them.
        skip: whether the decoder has a linear skip, φ(z) = N(z) − N(0) + A z.
        noise: denoising (Vincent et al. 2008): standard deviation of what is added to the encoder's input, as a share
            of each coordinate's root mean square; 0 for none.
        variational: weight of the Kullback–Leibler term of a variational autoencoder (Kingma and Welling 2014), as a
            share of the variance of the data; 0 for none.
        smoothness: weight of the curvature of the decoder between neighbouring codes; 0 for none.
        recorded_share: least share of recorded frames in an epoch beside rehearsed ones; they are repeated for it.
        equilibrium: weight of the loss of `losses.equilibrium_shift` in the last part of training; 0 for none.
        equilibrium_start: share of the epochs after which that loss sets in.
        device: a name that torch knows, or "auto" for CUDA where there is one.
    """

    hidden: tuple[int, ...] = (100, 100)
    activation: str = "elu"
    epochs: int = 400
    batch: int = 256
    learning_rate: float = 1e-2
    validation_share: float = 0.1
    patience: int = 400
    seed: int = 0
    balance: float = 0.5
    recorded_share: float = 0.0
    skip: bool = False
    noise: float = 0.0
    variational: float = 0.0
    smoothness: float = 0.0
    equilibrium: float = 0.0
    equilibrium_start: float = 0.5
    device: str = "auto"


@dataclass(frozen=True, eq=False)
class Forces:
    """Tangents and forces at some of the training poses, for the equilibrium loss.

    Attributes:
        frames: rows of q that they belong to, (p,) int64.
        stiffness: UᵀK(u)U at the true poses u, (p, k, k) float64, N/m in the coordinates of U.
        excess: Uᵀ(f(UUᵀMu) − f(u)), what projection alone adds to the internal force, (p, k) float64.
    """

    frames: NDArray[np.int64]
    stiffness: Array
    excess: Array


@dataclass(frozen=True, eq=False)
class Trained:
    """A trained autoencoder.

    Attributes:
        decoder, encoder: φ and ψ in float64.
        loss: weighted mean squared error in PCA coordinates after each epoch, (epochs, 2) float64 for training and
            validation.
        best_epoch: the epoch whose weights were kept.
    """

    decoder: Decoder
    encoder: Encoder
    loss: Array
    best_epoch: int
