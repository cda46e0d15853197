"""The pair of perceptrons in torch, and how they become the arrays that the compiled step reads.

ψ(q) = E(q) − E(0) and φ(z) = N(z) − N(0), so that rest maps to rest both ways, exactly, in every mode.
"""

from __future__ import annotations

import numpy as np
import torch

from ldsim.arrays import Array
from ldsim.errors import SolverError
from ldsim.learn.options import TrainOptions
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder

ACTIVATIONS = {"elu": torch.nn.ELU, "relu": torch.nn.ReLU, "tanh": torch.nn.Tanh, "sigmoid": torch.nn.Sigmoid}


def device_of(name: str) -> torch.device:
    """Where a training runs; "auto" is CUDA where there is one.

    Raises:
        SolverError: CUDA is asked for and not there.
    """
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name.startswith("cuda") and not torch.cuda.is_available():
        raise SolverError(f"train.device is {name}, but torch sees no CUDA device; use auto or cpu")
    return torch.device(name)


class Autoencoder(torch.nn.Module):
    """Encoder and decoder. A variational encoder also writes the logarithms of r variances.

    Args:
        spread: root mean square of each coordinate, (k,). The decoder's outputs are multiplied by it: the last
            coordinates are some thousand times smaller than the first, and a step that is the same for every weight
            would drown them in noise.
    """

    zero_q: torch.Tensor
    zero_z: torch.Tensor
    spread: torch.Tensor

    def __init__(self, r: int, spread: torch.Tensor, options: TrainOptions) -> None:
        super().__init__()
        k = len(spread)
        self.r = r
        self.activation = options.nonlinearity
        codes = 2 * r if options.variational else r
        self.encoder = perceptron([k, *reversed(options.layers), codes], options.nonlinearity)
        self.decoder = perceptron([r, *options.layers, k], options.nonlinearity)
        self.register_buffer("spread", spread)
        self.register_buffer("zero_q", torch.zeros(1, k))
        self.register_buffer("zero_z", torch.zeros(1, r))

    def encode(self, q: torch.Tensor) -> torch.Tensor:
        """ψ(q), (b, r); for a variational encoder the mean."""
        codes: torch.Tensor = self.encoder(q) - self.encoder(self.zero_q)
        return codes[:, : self.r]

    def log_variance(self, q: torch.Tensor) -> torch.Tensor:
        """Of a variational encoder, (b, r)."""
        codes: torch.Tensor = self.encoder(q)
        return codes[:, self.r :]

    def decode(self, z: torch.Tensor) -> torch.Tensor:
        """φ(z), (b, k)."""
        decoded: torch.Tensor = (self.decoder(z) - self.decoder(self.zero_z)) * self.spread
        return decoded

    def forward(self, q: torch.Tensor) -> torch.Tensor:
        return self.decode(self.encode(q))

    def jacobian(self, z: torch.Tensor) -> torch.Tensor:
        """∂φ/∂z of each row of z, (b, k, r)."""
        # Samples do not depend on each other, so k backward passes, one for each sum over a column, serve them all.
        summed = torch.autograd.functional.jacobian(  # type: ignore[no-untyped-call]
            lambda codes: self.decode(codes).sum(dim=0), z
        )
        return torch.as_tensor(summed).transpose(0, 1)


def perceptron(sizes: list[int], activation: str) -> torch.nn.Sequential:
    modules: list[torch.nn.Module] = []
    for i in range(len(sizes) - 1):
        modules.append(torch.nn.Linear(sizes[i], sizes[i + 1]))
        if i < len(sizes) - 2:
            modules.append(ACTIVATIONS[activation]())
    return torch.nn.Sequential(*modules)


def layers(perceptron: torch.nn.Module) -> tuple[list[Array], list[Array]]:
    """Weights (in, out) and biases (out,) of the linear layers, float64."""
    linear = [module for module in perceptron.modules() if isinstance(module, torch.nn.Linear)]
    weights = [layer.weight.detach().cpu().numpy().T.astype(np.float64) for layer in linear]
    return weights, [layer.bias.detach().cpu().numpy().astype(np.float64) for layer in linear]


def extract(model: Autoencoder, scale: float, q: Array, codes: int) -> tuple[Decoder, Encoder]:
    """The networks of the leading codes in float64, scales folded in.

    The latent space is rotated and scaled so that JᵀJ averages to the identity over the coordinates q, (N, k). Lengths
    and forces in z then mean what they mean in q, and one stop rule serves both spaces.
    """
    down, down_bias = layers(model.encoder)
    up, up_bias = layers(model.decoder)
    down[0] = down[0] / scale
    down[-1], down_bias[-1], up[0] = down[-1][:, :codes], down_bias[-1][:codes], up[0][:codes]
    spread = scale * model.spread.cpu().numpy().astype(np.float64)
    up[-1], up_bias[-1] = up[-1] * spread, up_bias[-1] * spread
    encoder = Encoder(tuple(down), tuple(down_bias), model.activation)
    decoder = Decoder.network(up, up_bias, model.activation)
    sample = encoder(q[:: max(len(q) // 200, 1)])
    metric = np.mean([J.T @ J for J in map(decoder.jacobian, sample)], axis=0)
    values, vectors = np.linalg.eigh(metric)
    root = vectors * np.sqrt(np.maximum(values, 1e-12 * values[-1]))
    inverse = np.linalg.inv(root)
    # z' = rootᵀ z, so the decoder reads z = root⁻ᵀ z' and the encoder writes rootᵀ z
    up[0] = inverse @ up[0]
    down[-1], down_bias[-1] = down[-1] @ root, down_bias[-1] @ root
    return Decoder.network(up, up_bias, model.activation), Encoder(tuple(down), tuple(down_bias), model.activation)
