"""The leading modes of many rows by random projection, in few passes (Halko, Martinsson and Tropp 2011, Alg. 4.3, 5.1).

The method of snapshots (pca.py) decomposes the products of all rows with each other, which of thousands takes minutes;
here a few times as many random combinations of the rows as modes are wanted span nearly the same, and once multiplied
by the rows' covariance more nearly still.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ldsim.arrays import Array
from ldsim.errors import SolverError
from ldsim.space.basis import Basis, weighted
from ldsim.space.pca import Chunks, orthonormalised

Rows = NDArray[np.float32]

# Combinations per mode that is wanted, and the share of the largest singular value below which a mode is rounding.
COMBINATIONS, TINY = 2, 1e-6


def sketched_modes(chunks: Chunks, metric: csr_array, most: int) -> Basis:
    """At most so many leading modes of rows (b, 3n) float32, orthonormal in the metric; fewer where fewer are there.

    Raises:
        SolverError: all rows are zero, or one is not finite.
    """
    rng, combined = np.random.default_rng(0), np.zeros((COMBINATIONS * most, 3 * metric.shape[0]))
    for chunk in chunks():
        combined += rng.normal(size=(len(combined), len(chunk))).astype(np.float32) @ chunk
    span = _orthonormal(combined, metric)
    combined[:] = 0.0
    combined = combined[: len(span)]
    for q, chunk in _coordinates(chunks, span, metric):
        combined += q.T @ chunk
    span = _orthonormal(combined, metric)
    products = np.zeros((len(span), len(span)))
    for q, _ in _coordinates(chunks, span, metric):
        products += q.T.astype(np.float64) @ q
    values, vectors = np.linalg.eigh(products)
    leading = np.flatnonzero(values > TINY**2 * values[-1])[::-1][:most]
    return orthonormalised(np.ascontiguousarray((vectors[:, leading].T @ span).T), metric)


def _coordinates(chunks: Chunks, span: Array, metric: csr_array) -> Iterator[tuple[Rows, Rows]]:
    """Each chunk of rows with its coordinates in the span, (b, m)."""
    dual = np.ascontiguousarray(weighted(metric, span).T, dtype=np.float32)
    return ((chunk @ dual, chunk) for chunk in chunks())


def _orthonormal(rows: Array, metric: csr_array) -> Array:
    """Rows with the same span, orthonormal in the metric, (m, 3n); what is rounding is left out."""
    products = weighted(metric, rows) @ rows.T
    if not np.isfinite(products).all() or not products.any():
        raise SolverError("the rows to find modes of are all zero, or one is not finite")
    values, vectors = np.linalg.eigh(products)
    some = values > TINY**2 * values[-1]
    return np.ascontiguousarray((vectors[:, some] / np.sqrt(values[some])).T @ rows)
