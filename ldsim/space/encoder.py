"""The encoder ψ: R^k → R^r, and the best latent state for a displacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldsim.arrays import Array
from ldsim.space.decoder import Decoder, check_layers


def _activate(kind: str, x: Array) -> Array:
    if kind == "elu":
        return np.where(x > 0, x, np.expm1(np.minimum(x, 0)))
    if kind == "relu":
        return np.maximum(x, 0)
    if kind == "tanh":
        return np.tanh(x)
    return 0.5 + 0.5 * np.tanh(0.5 * x)


@dataclass(frozen=True, eq=False)
class Encoder:
    """ψ(q) = E(q) − E(0) with E a multilayer perceptron; the identity where there are no weights.

    Attributes:
        weights: (in, out) float64 of each layer.
        biases: (out,) float64 of each layer.
        activation: a name of `activation.ACTIVATIONS`.

    Raises:
        ValueError: see `Decoder.network`.
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]
    activation: str = "elu"

    def __post_init__(self) -> None:
        if self.weights:
            check_layers(self.weights, self.biases, self.activation)

    def __call__(self, q: Array) -> Array:
        """z for a batch q, (N, k) → (N, r) float64."""
        if not self.weights:
            return q.copy()
        return self._perceptron(q) - self.rest

    @property
    def rest(self) -> Array:
        """E(0), (r,); there must be weights."""
        rest: Array = self._perceptron(np.zeros((1, len(self.weights[0]))))[0]
        return rest

    def _perceptron(self, x: Array) -> Array:
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = x @ weight + bias
            if i < len(self.weights) - 1:
                x = _activate(self.activation, x)
        return x


IDENTITY = Encoder((), ())


def nearest_latent(decoder: Decoder, q: Array, z: Array, iterations: int = 20) -> Array:
    """The z that minimises ‖φ(z) − q‖, (r,), by Levenberg–Marquardt from the guess z, (r,).

    With a mass-orthonormal basis the norm is the mass-weighted displacement error.
    """
    if decoder.is_identity:
        return q.copy()
    z = z.copy()
    residual = decoder(z) - q
    error, damping = float(residual @ residual), 1e-3
    for _ in range(iterations):
        J = decoder.jacobian(z)
        normal, gradient = J.T @ J, J.T @ residual
        trial = z - np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), gradient)
        trial_residual = decoder(trial) - q
        trial_error = float(trial_residual @ trial_residual)
        if trial_error < error:
            converged = error - trial_error <= 1e-10 * error
            z, residual, error, damping = trial, trial_residual, trial_error, damping * 0.1
            if converged:
                break
        else:
            damping *= 10
    return z
