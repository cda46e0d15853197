"""Sparse tangent stiffness over the free vertices, as 3×3 blocks on a fixed pattern."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csc_array, csr_array

from ldsim.arrays import Array, Indices
from ldsim.mechanics.elastic import Elements, add_elastic_stiffness


class StiffnessPattern:
    """Where the block of each pair of nodes goes, for free vertices numbered by `order`.

    Args:
        nodes: vertices of each quadrature point, (s, a) int32.
        order: the free vertices in the order of the matrix, (f,) integer.
        n_vertices: n, pinned vertices included.
    """

    def __init__(self, nodes: NDArray[np.int32], order: Indices, n_vertices: int) -> None:
        self.order = np.asarray(order, dtype=np.int64)
        position = np.full(n_vertices, -1, dtype=np.int64)
        position[self.order] = np.arange(len(self.order))
        local = position[nodes]
        rows = np.broadcast_to(local[:, :, None], (*local.shape, local.shape[1]))
        columns = np.broadcast_to(local[:, None, :], rows.shape)
        free = (rows >= 0) & (columns >= 0)
        keys, inverse = np.unique(rows[free] * len(self.order) + columns[free], return_inverse=True)
        self.slots = np.full(rows.shape, -1, dtype=np.int64)
        self.slots[free] = inverse
        self.rows, self.columns = np.divmod(keys, len(self.order))
        self.indptr = np.searchsorted(self.rows, np.arange(len(self.order) + 1))

    @property
    def n_free(self) -> int:
        return len(self.order)

    def blocks_of(self, scalar: csr_array) -> Array:
        """The entries of a scalar (n, n) matrix such as the mass, one for each block, (b,) float64."""
        permuted = csr_array(scalar[self.order][:, self.order])
        return np.asarray(permuted[self.rows, self.columns], dtype=np.float64).ravel()

    def stiffness_blocks(self, elements: Elements, u: Array, clamp: bool) -> Array:
        """K(u) as (b, 3, 3) float64 blocks, N/m; `clamp` makes every point's tangent positive semidefinite."""
        blocks = np.zeros((len(self.rows), 3, 3))
        add_elastic_stiffness(elements, u, self.slots, clamp, blocks)
        return blocks

    def matrix(self, blocks: Array) -> csc_array:
        """The symmetric (3f, 3f) matrix of the blocks; its compressed rows serve as its compressed columns."""
        size = 3 * self.n_free
        rows = bsr_array((blocks, self.columns, self.indptr), shape=(size, size)).tocsr()
        return csc_array((rows.data, rows.indices, rows.indptr), shape=(size, size))


def vertex_graph(nodes: NDArray[np.int32], free: Indices, n_vertices: int) -> csr_array:
    """Adjacency without the diagonal of the free vertices, numbered in the order of `free`."""
    pattern = StiffnessPattern(nodes, free, n_vertices)
    off = pattern.rows != pattern.columns
    ones = np.ones(int(off.sum()), dtype=np.int8)
    shape = (len(free), len(free))
    return csr_array((ones, (pattern.rows[off], pattern.columns[off])), shape=shape)
