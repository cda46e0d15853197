"""A decoder of degree two: z are the first coordinates of the basis, the others are quadratic in z (Jain, Tiso,
Rutzmoser and Rixen 2017; Barnett and Farhat 2022).

    φ(z) = [z, s(z) W],   s(z) = (zᵢ zⱼ) for i ≤ j

W is fitted to poses by one regularised least-squares solve, so no network is trained.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array


@dataclass(frozen=True, eq=False)
class QuadraticDecoder:
    """φ of a quadratic manifold, with what reproduction/rivals/every_element.py asks of a decoder.

    Attributes:
        weights: W, (r (r + 1) / 2, k - r) float64.
        r: how many numbers z has.
    """

    weights: Array
    r: int

    @property
    def k(self) -> int:
        """How many coordinates it decodes to."""
        return self.r + int(self.weights.shape[1])

    @property
    def is_identity(self) -> bool:
        """Never: it is a decoder."""
        return False

    def __call__(self, z: Array) -> Array:
        """φ(z), (k,), or of rows (b, r), (b, k)."""
        return np.concatenate([z, products(z) @ self.weights], axis=-1)

    def jacobian(self, z: Array) -> Array:
        """∂φ/∂z, (k, r)."""
        return np.vstack([np.eye(self.r), self._bends @ z])

    @cached_property
    def _bends(self) -> Array:
        """∂²φ/∂z² of the coordinates that are not z, (k - r, r, r)."""
        i, j = np.triu_indices(self.r)
        half = np.zeros((self.weights.shape[1], self.r, self.r))
        half[:, i, j] = self.weights.T
        found: Array = half + half.transpose(0, 2, 1)
        return found

    def vjp(self, z: Array, v: Array) -> Array:
        """(∂φ/∂z)ᵀ v, (r,), of v (k,)."""
        slope: Array = v @ self.jacobian(z)
        return slope


def products(z: Array) -> Array:
    """s(z), (..., r (r + 1) / 2): the products of two coordinates."""
    i, j = np.triu_indices(z.shape[-1])
    found: Array = z[..., i] * z[..., j]
    return found


def fitted(q: NDArray[np.floating], r: int, ridge: float) -> QuadraticDecoder:
    """The quadratic manifold nearest to poses, in the metric in which the basis is orthonormal.

    Args:
        q: coordinates of the poses, (N, k).
        ridge: how much W is held back, as a share of N where each product has unit mean square.
    """
    s, rest = products(np.asarray(q[:, :r], dtype=np.float64)), np.asarray(q[:, r:], dtype=np.float64)
    size = np.sqrt((s**2).mean(axis=0))
    s /= size
    weights = np.linalg.solve(s.T @ s + ridge * len(s) * np.eye(s.shape[1]), s.T @ rest)
    return QuadraticDecoder(weights / size[:, None], r)


def chosen(learned: Array, kept_back: Array, r: int, ridges: Sequence[float]) -> QuadraticDecoder:
    """The fit to some poses whose ridge leaves the least distance from others."""

    def off(decoder: QuadraticDecoder) -> float:
        return float(np.linalg.norm(decoder(kept_back[:, :r]) - kept_back))

    return min((fitted(learned, r, ridge) for ridge in ridges), key=off)
