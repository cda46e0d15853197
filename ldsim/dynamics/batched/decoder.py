"""The decoder on tensors: φ for a batch, its transposed Jacobian, and its second derivative against a force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import elu

from ldsim.space.activation import ACTIVATIONS
from ldsim.space.decoder import Decoder


class Activation(NamedTuple):
    """A function and, in terms of its value y, its first and second derivative."""

    value: Callable[[Tensor], Tensor]
    slope: Callable[[Tensor], Tensor]
    curvature: Callable[[Tensor], Tensor]


_BY_NAME = {
    "elu": Activation(elu, lambda y: torch.clamp(y, max=0) + 1, lambda y: torch.where(y > 0, 0.0, y + 1)),
    "relu": Activation(torch.relu, lambda y: (y > 0).to(y.dtype), torch.zeros_like),
    "sigmoid": Activation(torch.sigmoid, lambda y: y * (1 - y), lambda y: y * (1 - y) * (1 - 2 * y)),
    "tanh": Activation(torch.tanh, lambda y: 1 - y * y, lambda y: -2 * y * (1 - y * y)),
}
BY_NUMBER = {number: _BY_NAME[name] for name, number in ACTIVATIONS.items()}


class DecoderTangents(NamedTuple):
    """φ and its derivatives at a batch of z.

    q (n, k); jacobian (n, r, k), transposed; outputs: the activations of each hidden layer, (n, h); inputs: what goes
    into each, differentiated by z, (n, r, h).
    """

    q: Tensor
    jacobian: Tensor
    outputs: tuple[Tensor, ...]
    inputs: tuple[Tensor, ...]


@dataclass(frozen=True, eq=False)
class BatchedDecoder:
    """φ: R^r → R^k for batches, as `reduction.decoder.Decoder` defines it; the identity where there are no weights.

    Attributes:
        weights, biases: (in, out) and (out,) of each layer.
        rest: N(0), (k,).
        skip: (r, k), transposed, or None.
    """

    r: int
    k: int
    weights: tuple[Tensor, ...]
    biases: tuple[Tensor, ...]
    rest: Tensor
    skip: Tensor | None
    activation: Activation

    @classmethod
    def of(cls, decoder: Decoder, device: torch.device, dtype: torch.dtype) -> BatchedDecoder:
        def tensor(values: object) -> Tensor:
            return torch.as_tensor(values, dtype=dtype, device=device)

        layers = decoder.layers
        return cls(
            decoder.r,
            decoder.k,
            tuple(tensor(weight) for weight in decoder.weights),
            tuple(tensor(bias) for bias in decoder.biases),
            tensor(layers.rest),
            tensor(layers.skip) if layers.skip.size else None,
            BY_NUMBER[layers.activation],
        )

    def __call__(self, z: Tensor) -> Tensor:
        """φ(z), (n, r) → (n, k)."""
        return self.forward(z)[0]

    def forward(self, z: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
        """φ(z) and the activations of the hidden layers."""
        if not self.weights:
            return z, ()
        outputs: list[Tensor] = []
        x = z
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = self.activation.value(torch.addmm(bias, x, weight))
            outputs.append(x)
        q = torch.addmm(self.biases[-1] - self.rest, x, self.weights[-1])
        return q if self.skip is None else q + z @ self.skip, tuple(outputs)

    def pull_back(self, outputs: tuple[Tensor, ...], v: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Jᵀ v, (n, k) → (n, r), and what arrives at each hidden layer's output on the way, first layer first."""
        if not self.weights:
            return v, []
        arrived: list[Tensor] = []
        back = v
        for i in range(len(self.weights) - 1, 0, -1):
            back = back @ self.weights[i].T
            arrived.append(back)
            back = back * self.activation.slope(outputs[i - 1])
        back = back @ self.weights[0].T
        return back if self.skip is None else back + v @ self.skip.T, arrived[::-1]

    def tangents(self, z: Tensor) -> DecoderTangents:
        """φ with its Jacobian, forward through the layers."""
        q, outputs = self.forward(z)
        n = len(z)
        if not self.weights:
            return DecoderTangents(q, torch.eye(self.r, dtype=z.dtype, device=z.device).expand(n, -1, -1), (), ())
        inputs: list[Tensor] = []
        change = self.weights[0].expand(n, -1, -1)
        for i, output in enumerate(outputs):
            inputs.append(change)
            change = (change * self.activation.slope(output)[:, None]) @ self.weights[i + 1]
        return DecoderTangents(q, change if self.skip is None else change + self.skip, outputs, tuple(inputs))

    def curvature(self, at: DecoderTangents, v: Tensor) -> Tensor:
        """Σᵢ vᵢ ∂²φᵢ/∂z², (n, k) → (n, r, r): Σ over hidden units of σ'' times what arrives times the outer product."""
        total = torch.zeros(len(v), self.r, self.r, dtype=v.dtype, device=v.device)
        for output, change, arrived in zip(at.outputs, at.inputs, self.pull_back(at.outputs, v)[1], strict=True):
            total += (change * (self.activation.curvature(output) * arrived)[:, None]) @ change.transpose(1, 2)
        return total
