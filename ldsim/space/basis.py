"""A basis of displacements and the inner product in which it is orthonormal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array

from ldsim.arrays import Array
from ldsim.errors import SolverError


@dataclass(frozen=True, eq=False)
class Basis:
    """u = Σ_j q_j U_j, with UᵀMU = I in the inner product M.

    Attributes:
        fields: U, displacement of every vertex per column, (n, 3, k) float64.
        metric: M, the scalar matrix (n, n) of the inner product, applied to each axis; the mass, or the identity.
    """

    fields: Array
    metric: csr_array

    @classmethod
    def of(cls, matrix: Array, metric: csr_array) -> Basis:
        """From columns of displacements, (3n, k)."""
        return cls(matrix.reshape(metric.shape[0], 3, -1), metric)

    @property
    def k(self) -> int:
        """How many columns."""
        return int(self.fields.shape[2])

    @property
    def matrix(self) -> Array:
        """U as (3n, k)."""
        return self.fields.reshape(-1, self.k)

    @cached_property
    def dual(self) -> Array:
        """M U, (3n, k), by which coordinates are read off: there are fewer columns than rows that are projected."""
        return np.ascontiguousarray(weighted(self.metric, self.matrix.T).T)

    def columns(self, k: int) -> Basis:
        """The basis of the first k columns.

        Raises:
            SolverError: it has fewer.
        """
        if not 1 <= k <= self.k:
            raise SolverError(f"{k} columns of a basis are asked for; it has {self.k}")
        return replace(self, fields=np.ascontiguousarray(self.fields[:, :, :k]))

    def project(self, u: NDArray[np.floating]) -> Array:
        """q = Uᵀ M u of rows of displacements, (b, 3n) or (b, n, 3), metres; (b, k) float64."""
        found: Array = np.asarray(u, dtype=np.float64).reshape(len(u), -1) @ self.dual
        return found

    def displacement(self, q: Array) -> Array:
        """u = U q of coordinates (k,), (n, 3), or of rows of them (b, k), (b, n, 3); float64, metres."""
        if q.ndim == 1:
            return self.fields @ q
        return (q @ self.matrix.T).reshape(len(q), -1, 3)


def inner_product(mass: csr_array, kind: str) -> csr_array:
    """The scalar matrix (n, n) of an inner product, "mass" or "euclidean".

    Raises:
        SolverError: another one.
    """
    if kind not in ("mass", "euclidean"):
        raise SolverError(f"inner product is {kind!r}; known are mass, euclidean")
    return mass if kind == "mass" else csr_array(eye_array(mass.shape[0]))


def is_identity(metric: csr_array) -> bool:
    """Whether the inner product is the Euclidean one."""
    return bool(metric.nnz == metric.shape[0] and (metric.data == 1).all())


def weighted(metric: csr_array, fields: NDArray[np.floating]) -> Array:
    """Applies a scalar (n, n) metric to rows of displacements (b, 3n); (b, 3n) float64."""
    if is_identity(metric):
        return np.asarray(fields, dtype=np.float64)
    stacked = np.asarray(fields, dtype=np.float64).reshape(len(fields), -1, 3)
    # one product with all axes and rows side by side: the sparse matrix is read once
    moved = np.ascontiguousarray(stacked.transpose(1, 0, 2)).reshape(stacked.shape[1], -1)
    product = (metric @ moved).reshape(stacked.shape[1], len(fields), 3)
    return np.ascontiguousarray(product.transpose(1, 0, 2)).reshape(len(fields), -1)
