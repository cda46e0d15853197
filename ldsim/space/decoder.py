"""The decoder φ: R^r → R^k as compiled loops over contiguous arrays; the identity is the linear space.

φ(z) = N(z) − N(0) + A z: a multilayer perceptron N (paper, Sec. 4.3) without its value at zero, so that φ(0) = 0 to the
last bit, and an optional linear skip A, kept as Aᵀ so that every loop over it runs along memory. The paper's decoder
has neither; without the first it has no z for the rest shape (its Fig. 9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.jit import copy, kernel
from ldsim.space.activation import ACTIVATIONS, activate, slope

REASSOCIATE = {"reassoc", "contract", "nsz"}


class Layers(NamedTuple):
    """What the compiled loops read.

    sizes (layers + 1,): r, hidden widths, k — or the one number k for the identity. weights: every layer's (in, out)
    matrix, row by row, one after the other. biases: one after the other. rest (k,): N(0). skip (r, k): Aᵀ, or (0, 0)
    for none. activation: a number of `ACTIVATIONS`.
    """

    sizes: Indices
    weights: Array
    biases: Array
    rest: Array
    skip: Array
    activation: int


@kernel(fastmath=REASSOCIATE)
def _add_product(W: Array, x: Array, out: Array) -> None:
    """out += Wᵀ x for W (in, out), four rows at a time, so that `out` is loaded less often."""
    rows = W.shape[0]
    even = rows - rows % 4
    for i in range(0, even, 4):
        a, b, c, d = x[i], x[i + 1], x[i + 2], x[i + 3]
        A, B, C, D = W[i], W[i + 1], W[i + 2], W[i + 3]
        for j in range(out.shape[0]):
            out[j] += a * A[j] + b * B[j] + c * C[j] + d * D[j]
    for i in range(even, rows):
        for j in range(out.shape[0]):
            out[j] += x[i] * W[i, j]


@kernel()
def decode(layers: Layers, z: Array, hidden: Array, q: Array) -> None:
    """q = φ(z); `hidden` (sum of hidden widths,) keeps the activations for the derivatives."""
    sizes = layers.sizes
    if sizes.shape[0] == 1:  # the identity of the linear space
        copy(z, q)
        return
    last = sizes.shape[0] - 2
    w, b, source, target = 0, 0, 0, 0
    for layer in range(last + 1):
        rows, columns = sizes[layer], sizes[layer + 1]
        # every layer's activations are kept, for all derivatives follow from them
        out = q if layer == last else hidden[target : target + columns]
        copy(layers.biases[b : b + columns], out)
        x = z if layer == 0 else hidden[source : source + rows]
        _add_product(layers.weights[w : w + rows * columns].reshape(rows, columns), x, out)
        if layer < last:
            activate(layers.activation, out)
        w += rows * columns
        b += columns
        source, target = target, target + columns
    # N(0) was computed by these very loops, so that the difference at z = 0 is zero and not its rounding
    for j in range(q.shape[0]):
        q[j] -= layers.rest[j]
    if layers.skip.shape[0] > 0:
        _add_product(layers.skip, z, q)


@kernel(fastmath=REASSOCIATE)
def _add_image(W: Array, v: Array, out: Array) -> None:
    """out += W v for W (in, out), four rows at a time, so that v is loaded less often."""
    rows = W.shape[0]
    even = rows - rows % 4
    for i in range(0, even, 4):
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        A, B, C, D = W[i], W[i + 1], W[i + 2], W[i + 3]
        for j in range(v.shape[0]):
            a += A[j] * v[j]
            b += B[j] * v[j]
            c += C[j] * v[j]
            d += D[j] * v[j]
        out[i] += a
        out[i + 1] += b
        out[i + 2] += c
        out[i + 3] += d
    for i in range(even, rows):
        total = 0.0
        for j in range(v.shape[0]):
            total += W[i, j] * v[j]
        out[i] += total


@kernel()
def decode_vjp(layers: Layers, hidden: Array, v: Array, scratch: Array, gradient: Array) -> None:
    """gradient = J(z)ᵀ v at the z last decoded into `hidden`; `scratch` is as long as `hidden`."""
    sizes = layers.sizes
    if sizes.shape[0] == 1:
        copy(v, gradient)
        return
    last = sizes.shape[0] - 2
    # backwards through the flat arrays, from the ends of both
    w = layers.weights.shape[0]
    end = hidden.shape[0]
    for layer in range(last, -1, -1):
        rows, columns = sizes[layer], sizes[layer + 1]
        w -= rows * columns
        incoming = v if layer == last else scratch[end : end + columns]
        start = end - rows
        out = gradient if layer == 0 else scratch[start:end]
        out[:] = 0.0
        _add_image(layers.weights[w : w + rows * columns].reshape(rows, columns), incoming, out)
        if layer > 0:
            for i in range(rows):
                out[i] *= slope(layers.activation, hidden[start + i])
        end = start
    if layers.skip.shape[0] > 0:
        _add_image(layers.skip, v, gradient)


@kernel(fastmath=REASSOCIATE)
def _add_rows(W: Array, X: Array, out: Array) -> None:
    """out += X W for X (r, in) and W (in, out), all rows of X while four of W are in the cache."""
    rows = W.shape[0]
    even = rows - rows % 4
    for i in range(0, even, 4):
        for a in range(X.shape[0]):
            x0, x1, x2, x3 = X[a, i], X[a, i + 1], X[a, i + 2], X[a, i + 3]
            for j in range(W.shape[1]):
                out[a, j] += (x0 * W[i, j] + x1 * W[i + 1, j]) + (x2 * W[i + 2, j] + x3 * W[i + 3, j])
    for i in range(even, rows):
        for a in range(X.shape[0]):
            for j in range(W.shape[1]):
                out[a, j] += X[a, i] * W[i, j]


@kernel()
def decode_jacobian(layers: Layers, hidden: Array, tangents: Array, jacobian: Array) -> None:
    """jacobian (r, k) = J(z)ᵀ at the z last decoded into `hidden`, one tangent a row; `tangents` is (r · hidden,)."""
    sizes = layers.sizes
    r = sizes[0]
    if sizes.shape[0] == 1:
        jacobian[:] = 0.0
        for i in range(r):
            jacobian[i, i] = 1.0
        return
    last = sizes.shape[0] - 2
    w, source, target = 0, 0, 0
    for layer in range(last + 1):
        rows, columns = sizes[layer], sizes[layer + 1]
        W = layers.weights[w : w + rows * columns].reshape(rows, columns)
        out = jacobian if layer == last else tangents[r * target : r * (target + columns)].reshape(r, columns)
        if layer == 0:  # its tangents along the unit vectors are the rows of W
            for i in range(r):
                copy(W[i], out[i])
        else:
            out[:] = 0.0
            _add_rows(W, tangents[r * source : r * (source + rows)].reshape(r, rows), out)
        if layer < last:
            # j outside, although it strides over memory: its slope then serves all r tangents
            for j in range(columns):
                steepness = slope(layers.activation, hidden[target + j])
                for i in range(r):
                    out[i, j] *= steepness
        w += rows * columns
        source, target = target, target + columns
    if layers.skip.shape[0] > 0:
        for i in range(r):
            for j in range(jacobian.shape[1]):
                jacobian[i, j] += layers.skip[i, j]


def check_layers(weights: Sequence[Array], biases: Sequence[Array], activation: str) -> None:
    """Refuse what is no perceptron.

    Raises:
        ValueError: see `Decoder.network`.
    """
    shapes = [(w.shape, b.shape) for w, b in zip(weights, biases, strict=True)]
    chained = all(w.ndim == 2 and w.size and b.shape == w.shape[1:] for w, b in zip(weights, biases, strict=True))
    if not shapes or not chained or any(a != b[:1] for (_, a), (b, _) in pairwise(shapes)):
        raise ValueError(f"layers have weights and biases of shapes {shapes}; expected (in, out) and (out,), chained")
    if not all(np.isfinite(values).all() for values in (*weights, *biases)):
        raise ValueError("a weight or a bias of a network is not finite")
    if activation not in ACTIVATIONS:
        raise ValueError(f"activation is {activation!r}; known are {', '.join(ACTIVATIONS)}")


@dataclass(frozen=True, eq=False)
class Decoder:
    """φ: R^r → R^k with φ(0) = 0, ready for the compiled loops.

    Make it with `Decoder.identity(k)` or `Decoder.network(...)`.
    """

    layers: Layers

    @classmethod
    def identity(cls, k: int) -> Decoder:
        """q = z: the linear space of dimension k."""
        none = np.empty(0)
        return cls(Layers(np.array([k]), none, none, none, np.empty((0, 0)), 0))

    @classmethod
    def network(
        cls,
        weights: Sequence[Array],
        biases: Sequence[Array],
        activation: str = "elu",
        skip: Array | None = None,
    ) -> Decoder:
        """A perceptron of (in, out) weights and (out,) biases, less its value at 0, plus the skip Aᵀ (r, k).

        Raises:
            ValueError: shapes that do not chain, which the compiled loops would not notice, numbers that are not
                finite, or an unknown activation.
        """
        check_layers(weights, biases, activation)
        sizes = np.array([weights[0].shape[0], *(w.shape[1] for w in weights)], dtype=np.int64)
        if skip is not None and (skip.shape != (sizes[0], sizes[-1]) or not np.isfinite(skip).all()):
            raise ValueError(
                f"the skip has shape {skip.shape}; expected (r, k) = ({sizes[0]}, {sizes[-1]}), all finite"
            )
        flat = np.concatenate([np.ascontiguousarray(w, dtype=np.float64).ravel() for w in weights])
        offsets = np.concatenate([np.asarray(b, dtype=np.float64) for b in biases])
        matrix = np.empty((0, 0)) if skip is None else np.ascontiguousarray(skip, dtype=np.float64)
        zero, nothing = np.zeros(sizes[-1]), np.empty((0, 0))
        layers = Layers(sizes, flat, offsets, zero, nothing, ACTIVATIONS[activation])
        rest = np.empty(sizes[-1])
        decode(layers, np.zeros(sizes[0]), np.empty(int(sizes[1:-1].sum())), rest)
        return cls(Layers(sizes, flat, offsets, rest, matrix, ACTIVATIONS[activation]))

    def times(self, matrix: Array) -> Decoder:
        """The network of φ(z) times a matrix, (k, j)."""
        *hidden, last = self.weights
        *offsets, offset = self.biases
        activation = next(name for name, number in ACTIVATIONS.items() if number == self.layers.activation)
        skip = None if self.skip is None else self.skip @ matrix
        return Decoder.network([*hidden, last @ matrix], [*offsets, offset @ matrix], activation, skip)

    @property
    def r(self) -> int:
        return int(self.layers.sizes[0])

    @property
    def k(self) -> int:
        return int(self.layers.sizes[-1])

    @property
    def weights(self) -> list[Array]:
        """The (in, out) matrix of each layer; none for the identity."""
        sizes = self.layers.sizes
        flat = np.split(self.layers.weights, np.cumsum(sizes[:-1] * sizes[1:])[:-1]) if len(sizes) > 1 else []
        return [part.reshape(sizes[i], sizes[i + 1]) for i, part in enumerate(flat)]

    @property
    def biases(self) -> list[Array]:
        """The (out,) offsets of each layer; none for the identity."""
        sizes = self.layers.sizes
        return np.split(self.layers.biases, np.cumsum(sizes[1:])[:-1]) if len(sizes) > 1 else []

    @property
    def skip(self) -> Array | None:
        """Aᵀ of the linear skip, (r, k); None where there is none."""
        return self.layers.skip if self.layers.skip.size else None

    @property
    def is_identity(self) -> bool:
        return len(self.layers.sizes) == 1

    @property
    def hidden_size(self) -> int:
        """Length of the `hidden` and `scratch` arrays of the compiled loops."""
        return int(self.layers.sizes[1:-1].sum())

    def __call__(self, z: Array) -> Array:
        """φ(z) for (r,) or a batch (N, r); returns (k,) or (N, k) float64."""
        batch = np.atleast_2d(np.asarray(z, dtype=np.float64))
        q = np.empty((len(batch), self.k))
        hidden = np.empty(self.hidden_size)
        for i in range(len(batch)):
            decode(self.layers, batch[i], hidden, q[i])
        return q.reshape(*np.shape(z)[:-1], self.k)

    def jacobian(self, z: Array) -> Array:
        """J = ∂φ/∂z at z (r,), (k, r) float64."""
        hidden, tangents = np.empty(self.hidden_size), np.empty(self.r * self.hidden_size)
        transposed = np.empty((self.r, self.k))
        decode(self.layers, np.asarray(z, dtype=np.float64), hidden, np.empty(self.k))
        decode_jacobian(self.layers, hidden, tangents, transposed)
        return np.ascontiguousarray(transposed.T)

    def vjp(self, z: Array, v: Array) -> Array:
        """J(z)ᵀ v for z (r,) and v (k,); (r,) float64."""
        hidden, scratch = np.empty(self.hidden_size), np.empty(self.hidden_size)
        gradient = np.empty(self.r)
        decode(self.layers, np.asarray(z, dtype=np.float64), hidden, np.empty(self.k))
        decode_vjp(self.layers, hidden, np.asarray(v, dtype=np.float64), scratch, gradient)
        return gradient
