"""PCA of snapshots in bounded memory: the method of snapshots on streamed chunks (Sirovich 1987).

No mean is subtracted, so that the rest shape u = 0 is in every basis. The inner product is the mass or the Euclidean
one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import eigh, solve_triangular
from scipy.sparse import csr_array, eye_array

from ldsim.errors import SolverError

Array = NDArray[np.float64]
Chunks = Callable[[], Iterable[NDArray[np.float32]]]


@dataclass(frozen=True, eq=False)
class Basis:
    """An orthonormal basis of displacements.

    Attributes:
        U: (3n, k) float64; UᵀMU = I for the mass inner product, UᵀU = I for the Euclidean one.
        singular_values: of the snapshots in that inner product, (K,) float64 with K ≥ k, falling.
        max_error, mean_error: largest and mean vertex distance over the training snapshots when 0, 1, … columns are
            kept, (k + 1,) float64, metres.
    """

    U: Array
    singular_values: Array
    max_error: Array
    mean_error: Array

    @property
    def k(self) -> int:
        return int(self.U.shape[1])


def inner_product(mass: csr_array, kind: str) -> csr_array:
    """The scalar matrix (n, n) of an inner product, "mass" or "euclidean"."""
    return mass if kind == "mass" else csr_array(eye_array(mass.shape[0]))


def weighted(metric: csr_array, fields: NDArray[np.floating]) -> Array:
    """Applies a scalar (n, n) metric to rows of displacements (b, 3n); (b, 3n) float64."""
    stacked = np.asarray(fields, dtype=np.float64).reshape(len(fields), -1, 3)
    moved = np.ascontiguousarray(stacked.transpose(1, 0, 2)).reshape(stacked.shape[1], -1)
    product = (metric @ moved).reshape(stacked.shape[1], len(fields), 3)
    return np.ascontiguousarray(product.transpose(1, 0, 2)).reshape(len(fields), -1)


def coordinates(metric: csr_array, U: Array, fields: NDArray[np.floating]) -> Array:
    """q = Uᵀ M u for rows of displacements (b, 3n); (b, k) float64."""
    q: Array = weighted(metric, fields) @ U
    return q


def gram_matrix(chunks: Chunks, metric: csr_array) -> Array:
    """X M Xᵀ over all snapshots, (N, N) float64; holds two chunks at a time."""
    rows = []
    for i, left in enumerate(chunks()):
        product = weighted(metric, left)
        blocks = [product @ right.T.astype(np.float64) for j, right in enumerate(chunks()) if j <= i]
        rows.append(np.hstack(blocks))
    total = sum(len(row) for row in rows)
    gram = np.zeros((total, total))
    start = 0
    for row in rows:
        gram[start : start + len(row), : row.shape[1]] = row
        start += len(row)
    lower = np.tril(gram)
    symmetric: Array = lower + np.tril(lower, -1).T
    return symmetric


def leading_modes(chunks: Chunks, metric: csr_array, k: int) -> tuple[Array, Array]:
    """The k leading modes (3n, k) and all singular values, float64.

    Raises:
        SolverError: fewer than k snapshots are independent, or one is not finite.
    """
    gram = gram_matrix(chunks, metric)
    if not np.isfinite(gram).all():
        frame = int(np.argwhere(~np.isfinite(np.diag(gram)))[0, 0])
        raise SolverError(f"training snapshot {frame} holds a displacement that is not finite; rerun snapshot")
    squares, vectors = eigh(gram)
    squares, vectors = squares[::-1], vectors[:, ::-1]
    singular = np.sqrt(np.maximum(squares, 0))
    if singular[0] == 0:
        raise SolverError("all training snapshots are zero; nothing moves, so there is no basis to find")
    # float32 snapshots carry seven digits, so their Gram matrix carries directions down to 1e-6 of the first
    rank = int((singular > 1e-6 * singular[0]).sum())
    if rank < k:
        raise SolverError(f"k = {k} but only {rank} of {len(gram)} training snapshots are independent; lower pca.k")
    modes = None
    start = 0
    for chunk in chunks():
        part = chunk.T.astype(np.float64) @ (vectors[start : start + len(chunk), :k] / singular[:k])
        modes = part if modes is None else modes + part
        start += len(chunk)
    assert modes is not None
    return orthonormalised(orthonormalised(modes, metric), metric), singular


def orthonormalised(U: Array, metric: csr_array) -> Array:
    """The same span and order with UᵀMU = I, by Cholesky; each column's largest entry made positive."""
    factor = np.linalg.cholesky(weighted(metric, U.T) @ U)
    Q = solve_triangular(factor, U.T, lower=True).T
    signs = np.sign(Q[np.abs(Q).argmax(axis=0), np.arange(Q.shape[1])])
    return np.ascontiguousarray(Q * signs)


@njit(cache=True, nogil=True)
def _accumulate_errors(fields: Array, q: Array, UT: Array, largest: Array, total: Array) -> None:
    """Subtracts one mode after another from each snapshot and records the vertex errors left over."""
    k, size = UT.shape
    residual = np.empty(size)
    for t in range(fields.shape[0]):
        residual[:] = fields[t]
        for j in range(k + 1):
            worst, sum_ = 0.0, 0.0
            for v in range(0, size, 3):
                square = residual[v] ** 2 + residual[v + 1] ** 2 + residual[v + 2] ** 2
                worst = max(worst, square)
                sum_ += np.sqrt(square)
            largest[j] = max(largest[j], np.sqrt(worst))
            total[j] += sum_
            if j < k:
                a = q[t, j]
                mode = UT[j]
                for i in range(size):
                    residual[i] -= a * mode[i]


def errors_against_k(chunks: Chunks, metric: csr_array, U: Array) -> tuple[Array, Array]:
    """Largest and mean vertex distance, metres, when the first 0 … k modes are kept; each (k + 1,) float64."""
    UT = np.ascontiguousarray(U.T)
    largest, total = np.zeros(U.shape[1] + 1), np.zeros(U.shape[1] + 1)
    count = 0
    for chunk in chunks():
        fields = np.asarray(chunk, dtype=np.float64)
        _accumulate_errors(fields, coordinates(metric, U, fields), UT, largest, total)
        count += fields.shape[0] * fields.shape[1] // 3
    return largest, total / count


def fit_basis(chunks: Chunks, metric: csr_array, k: int | None, tolerance: float, max_k: int) -> Basis:
    """A basis of k modes, or of the fewest that keep every vertex of every snapshot within the tolerance.

    Args:
        chunks: yields rows of displacements (b, 3n) float32, the same sequence each time it is called.
        k: number of modes, or None for the max-vertex-error rule (paper, Sec. 4.3).
        tolerance: metres, for k = None.
        max_k: the largest k tried for k = None.

    Raises:
        SolverError: k is larger than the number of independent snapshots, or max_k modes miss the tolerance.
    """
    count = sum(len(chunk) for chunk in chunks())
    if count == 0:
        raise SolverError("there are no training snapshots; give at least one motion the role train")
    wanted = k if k is not None else min(max_k, count)
    if wanted > count:
        raise SolverError(f"k = {wanted} but there are only {count} training snapshots; lower pca.k")
    if k is None:
        wanted = min(wanted, _independent(chunks, metric))
    U, singular = leading_modes(chunks, metric, wanted)
    max_error, mean_error = errors_against_k(chunks, metric, U)
    if k is None:
        within = np.flatnonzero(max_error <= tolerance)
        if len(within) == 0 and wanted == max_k:
            raise SolverError(
                f"{max_k} modes leave a vertex error of {1e3 * max_error[-1]:.3g} mm, allowed are "
                f"{1e3 * tolerance:.3g} mm; raise pca.max_k or pca.tolerance_mm"
            )
        wanted = max(int(within[0]), 1) if len(within) else wanted
    return Basis(np.ascontiguousarray(U[:, :wanted]), singular, max_error[: wanted + 1], mean_error[: wanted + 1])


def _independent(chunks: Chunks, metric: csr_array) -> int:
    squares = np.linalg.eigvalsh(gram_matrix(chunks, metric))
    return max(int((squares > 1e-12 * squares[-1]).sum()), 1)
