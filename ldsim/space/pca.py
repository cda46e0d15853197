"""PCA of snapshots in bounded memory: the method of snapshots on streamed chunks (Sirovich 1987).

No mean is subtracted, so that the rest shape u = 0 is in every basis. The inner product is the mass or the Euclidean
one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, solve_triangular
from scipy.sparse import csr_array

from ldsim.arrays import Array
from ldsim.errors import SolverError
from ldsim.jit import in_threads, njit
from ldsim.space.basis import Basis, is_identity, weighted
from ldsim.space.options import PcaOptions

Chunks = Callable[[], Iterable[NDArray[np.float32]]]

# Columns that are multiplied at a time, and the share of the largest singular value down to which it serves to sum
# their products in single precision.
BLOCK = 16384
SINGLE = 1e-3
# Chunks whose products with all others are formed in one pass over those.
HELD = 3


@dataclass(frozen=True, eq=False)
class Pca:
    """A basis found in snapshots, and how well it holds them.

    Attributes:
        singular_values: of the snapshots in the basis's inner product, (K,) float64 with K ≥ k, falling.
        max_error, mean_error: largest and mean vertex distance over the training snapshots when 0, 1, … columns are
            kept, (k + 1,) float64, metres.
        validation_max_error, validation_mean_error: the same over validation snapshots; None where there are none.
        synthetic: coordinates of the frames of synthetic motions, (f, k); None where there are none.
    """

    basis: Basis
    singular_values: Array
    max_error: Array
    mean_error: Array
    validation_max_error: Array | None = None
    validation_mean_error: Array | None = None
    synthetic: NDArray[np.float32] | None = None


def gram_matrix(chunks: Chunks, metric: csr_array, products: type[np.floating] = np.float64) -> Array:
    """X M Xᵀ over all snapshots, (N, N) float64; reads them once for every `HELD` chunks, and holds few more than that.

    Args:
        products: np.float32 halves the time; products of a few columns are then summed in float64. What is smaller
            than about 1e-4 of the largest singular value is lost in their rounding.
    """
    rows: list[list[Array]] = []
    stream = iter(chunks())
    while held := list(islice(stream, HELD)):
        lefts = [_for_products(metric, chunk, products) for chunk in held]
        here: list[list[Array]] = [[] for _ in lefts]
        for right in islice(chunks(), len(rows)):
            for row, left in zip(here, lefts, strict=True):
                row.append(_products(left, right))
        for i, (row, left) in enumerate(zip(here, lefts, strict=True)):
            row.extend(_products(left, right) for right in held[: i + 1])
        rows += here
    return _symmetric([np.hstack(row) for row in rows])


def _symmetric(rows: list[Array]) -> Array:
    """The symmetric matrix whose lower triangle is in these blocks of rows."""
    total = sum(len(row) for row in rows)
    gram = np.zeros((total, total))
    start = 0
    for row in rows:
        gram[start : start + len(row), : row.shape[1]] = row
        start += len(row)
    lower = np.tril(gram)
    return lower + np.tril(lower, -1).T


def _for_products(metric: csr_array, chunk: NDArray[np.float32], products: type[np.floating]) -> NDArray[np.floating]:
    return (chunk if is_identity(metric) else weighted(metric, chunk)).astype(products, copy=False)


def _products(left: NDArray[np.floating], right: NDArray[np.float32]) -> Array:
    """left rightᵀ, float64, in blocks of columns: each block in the precision of `left`, their sum in float64.

    The blocks, not what BLAS does of one, are shared out to the cores: the sum is the same whatever their number.
    """

    def of_block(block: slice) -> NDArray[np.floating]:
        product: NDArray[np.floating] = left[:, block] @ right[:, block].T.astype(left.dtype, copy=False)
        return product

    total = np.zeros((len(left), len(right)))
    for product in in_threads(of_block, _blocks(left.shape[1])):
        total += product
    return total


def _blocks(columns: int) -> Iterator[slice]:
    """Columns in pieces that stay in the cache."""
    return (slice(start, start + BLOCK) for start in range(0, columns, BLOCK))


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The decomposed Gram matrix: singular values, falling, and the snapshots' coefficients of each mode, (N, N)."""

    singular_values: Array
    vectors: Array

    @property
    def independent(self) -> int:
        """How many snapshots are: float32 carries seven digits, so directions down to 1e-6 of the first."""
        return int((self.singular_values > 1e-6 * self.singular_values[0]).sum())


def spectrum(chunks: Chunks, metric: csr_array, wanted: int | None = None) -> Spectrum:
    """Singular values and coefficients of the snapshots.

    Args:
        wanted: the number of modes that will be used; where their singular values lie well above the rounding of
            float32 products, those are used, and float64 else.

    Raises:
        SolverError: a snapshot is not finite, or all are zero.
    """
    if wanted is not None:
        quick = _decomposed(gram_matrix(chunks, metric, np.float32))
        if quick.singular_values[min(wanted, len(quick.vectors)) - 1] > SINGLE * quick.singular_values[0]:
            return quick
    return _decomposed(gram_matrix(chunks, metric))


def _decomposed(gram: Array) -> Spectrum:
    if not np.isfinite(gram).all():
        frame = int(np.argwhere(~np.isfinite(np.diag(gram)))[0, 0])
        raise SolverError(f"training snapshot {frame} holds a displacement that is not finite; rerun snapshot")
    squares, vectors = eigh(gram)
    singular = np.sqrt(np.maximum(squares[::-1], 0))
    if singular[0] == 0:
        raise SolverError("all training snapshots are zero; nothing moves, so there is no basis to find")
    return Spectrum(singular, vectors[:, ::-1])


def leading_modes(chunks: Chunks, metric: csr_array, k: int, found: Spectrum | None = None) -> tuple[Basis, Array]:
    """The k leading modes and all singular values, float64.

    Raises:
        SolverError: fewer than k snapshots are independent, or one is not finite.
    """
    found = found if found is not None else spectrum(chunks, metric, k)
    singular = found.singular_values
    if found.independent < k:
        raise SolverError(
            f"k = {k} but only {found.independent} of {len(singular)} training snapshots are independent; lower pca.k"
        )
    rows = np.zeros((k, 3 * metric.shape[0]))
    start = 0
    for chunk in chunks():
        weights = (found.vectors[start : start + len(chunk), :k] / singular[:k]).T
        for block in _blocks(chunk.shape[1]):
            rows[:, block] += weights @ chunk[:, block].astype(np.float64)
        start += len(chunk)
    # Once more, for what rounding left.
    return orthonormalised(orthonormal_rows(rows, metric).T, metric), singular


def orthonormalised(U: Array, metric: csr_array) -> Basis:
    """The same span and order with UᵀMU = I, by Cholesky; each column's largest entry made positive."""
    Q = orthonormal_rows(np.ascontiguousarray(U.T), metric)
    signs = np.sign(Q[np.arange(len(Q)), np.abs(Q).argmax(axis=1)])
    return Basis.of(np.ascontiguousarray((Q * signs[:, None]).T), metric)


def orthonormal_rows(rows: Array, metric: csr_array) -> Array:
    """Cholesky QR of modes (k, 3n) that are rows, each in one piece of memory."""
    factor = np.linalg.cholesky(weighted(metric, rows) @ rows.T)
    return solve_triangular(factor, np.eye(len(rows)), lower=True) @ rows


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


def errors_against_k(chunks: Chunks, basis: Basis) -> tuple[Array, Array]:
    """Largest and mean vertex distance, metres, when the first 0 … k modes are kept; each (k + 1,) float64."""
    UT = np.ascontiguousarray(basis.matrix.T)
    largest, total = np.zeros(basis.k + 1), np.zeros(basis.k + 1)
    count = 0
    for chunk in chunks():
        fields = np.asarray(chunk, dtype=np.float64)
        _accumulate_errors(fields, basis.project(fields), UT, largest, total)
        count += fields.shape[0] * fields.shape[1] // 3
    return largest, total / count


def turned(found: Pca, recorded: Array, synthetic: Array, chunks: Chunks) -> Pca:
    """The same span with its columns turned so that the first hold recorded and synthetic frames together best.

    A short basis is then made for all the motions that a network learns from. Recorded frames weigh at least as much as
    synthetic ones, as in a training (`TrainOptions.recorded_share`).

    Args:
        recorded, synthetic: coordinates of the frames in the columns that were found, (N, k) and (f, k).
        chunks: the recorded snapshots, for the errors.
    """
    weight = max(len(synthetic) / len(recorded), 1.0)
    _, vectors = np.linalg.eigh(weight * recorded.T @ recorded + synthetic.T @ synthetic)
    rotation = vectors[:, ::-1]
    columns = found.basis.matrix @ rotation
    signs = np.sign(columns[np.abs(columns).argmax(axis=0), np.arange(columns.shape[1])])
    basis = Basis.of(np.ascontiguousarray(columns * signs), found.basis.metric)
    largest, mean = errors_against_k(chunks, basis)
    coordinates = (synthetic @ (rotation * signs)).astype(np.float32)
    return replace(found, basis=basis, max_error=largest, mean_error=mean, synthetic=coordinates)


class Kept(Protocol):
    """Where an interrupted fit or training finds its state again, as plain arrays."""

    def load(self) -> Mapping[str, NDArray[np.generic]] | None:
        """What was saved of this very fit, or None."""

    def save(self, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        """Replace what was saved."""


def _kept_spectrum(chunks: Chunks, metric: csr_array, wanted: int | None, kept: Kept | None) -> Spectrum:
    """The spectrum that was kept, in the order of memory in which it was found, or found now."""
    arrays = None if kept is None else kept.load()
    if arrays is not None:
        return Spectrum(arrays["singular_values"].astype(np.float64), arrays["rising"].astype(np.float64).T[:, ::-1])
    found = spectrum(chunks, metric, wanted)
    if kept is not None:
        kept.save({"singular_values": found.singular_values, "rising": found.vectors[:, ::-1].T})
    return found


def fit_basis(chunks: Chunks, metric: csr_array, options: PcaOptions, kept: Kept | None = None) -> Pca:
    """A basis of as many modes as the options ask for.

    Args:
        chunks: yields rows of displacements (b, 3n) float32, the same sequence each time it is called.
        kept: where the spectrum, which takes most of the time, outlives an interruption.

    Raises:
        SolverError: k is larger than the number of independent snapshots, or max_k modes miss the tolerance.
    """
    count = sum(len(chunk) for chunk in chunks())
    if count == 0:
        raise SolverError("there are no training snapshots; give at least one motion the role train")
    if options.k is not None and options.k > count:
        raise SolverError(f"k = {options.k} but there are only {count} training snapshots; lower pca.k")
    found = _kept_spectrum(chunks, metric, options.columns, kept)
    most = options.k or min(options.columns or options.max_k, found.independent)
    basis, singular = leading_modes(chunks, metric, most, found)
    max_error, mean_error = errors_against_k(chunks, basis)
    wanted = most
    if options.k is None and options.criterion is not None:
        squares = np.concatenate([[0.0], np.cumsum(singular**2)])
        lost = {"max_error": max_error, "mean_error": mean_error, "energy": 1 - squares / squares[-1]}[
            options.criterion
        ]
        within = np.flatnonzero(lost[: most + 1] <= options.tolerance)
        if len(within) == 0 and most == options.max_k:
            raise SolverError(f"{most} modes {options.describe(lost[most])}")
        wanted = max(int(within[0]), 1) if len(within) else most
    return Pca(basis.columns(wanted), singular, max_error[: wanted + 1], mean_error[: wanted + 1])
