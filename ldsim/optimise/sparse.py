"""Direct factorisation of sparse symmetric positive definite matrices of 3×3 blocks: multifrontal Cholesky.

Duff and Reid 1983, "The multifrontal solution of indefinite sparse symmetric linear equations". METIS orders, LAPACK
factorises the dense fronts; what is here only moves numbers between them. SciPy's SuperLU treats the matrix as
unsymmetric: on the X of 29,686 tets it took four times as long to factorise and twice as long to solve.
"""

from __future__ import annotations

import numpy as np

from ldsim.arrays import Array, Indices, Numbers
from ldsim.errors import SolverError
from ldsim.jit import njit
from ldsim.optimise.elimination import Elimination, children
from ldsim.optimise.lapack import potrf, syrk, trsm, trtri


class NotPositive(Exception):
    """A pivot that is not positive: the matrix is not positive definite in this precision."""


class Factor:
    """The factor L of a symmetric positive definite matrix A = L Lᵀ whose order already reduces fill.

    Args:
        elimination: its structure, from the pattern of the blocks.
        indptr, indices: the pattern, compressed rows of blocks, (f + 1,) and (b,).
        blocks: the 3×3 blocks, (b, 3, 3) float64; those above the diagonal are not read.
        single: hold the factor in float32, for a preconditioner; in float64 where float32 cannot.

    Attributes:
        values: of each supernode in turn the inverse of its triangle, then the block of the rows below it, both column
            by column.

    Raises:
        SolverError: the matrix is not positive definite, or its factor does not fit in memory.
    """

    def __init__(
        self, elimination: Elimination, indptr: Indices, indices: Indices, blocks: Array, single: bool = False
    ) -> None:
        self.elimination = elimination
        columns = np.diff(elimination.first)
        sizes = 9 * columns * (columns + np.diff(elimination.row_start))
        self._start = np.concatenate([[0], np.cumsum(sizes)])
        size = 3 * int(elimination.first[-1])
        try:
            if single:
                try:
                    self.values: Numbers = self._factorise(indptr, indices, blocks, np.float32)
                    return
                except NotPositive:
                    pass
            self.values = self._factorise(indptr, indices, blocks, np.float64)
        except NotPositive as error:
            raise SolverError(
                f"the system matrix of {size} unknowns cannot be factorised ({error}); "
                "check that the pins let no part of the solid float or turn: three of its vertices, not in a line"
            ) from error
        except MemoryError as error:
            raise SolverError(
                f"the factor of {size} unknowns, {factor_bytes(elimination) / 1e9:.1f} GB, does not fit in memory; set "
                "snapshot.linear_solver: multigrid, or fewer snapshot.workers"
            ) from error

    def solve(self, right: Array) -> Array:
        """x with A x = right, (3f,) float64, to the precision of the factor."""
        e = self.elimination
        x = right.astype(self.values.dtype)
        largest = int((np.diff(e.first) + np.diff(e.row_start)).max(initial=0))
        work = np.empty(3 * largest, dtype=x.dtype)
        _solve(self.values, self._start, e.first, e.row_start, e.rows, x, work)
        return x.astype(np.float64)

    def solve_rows(self, right: Array) -> Array:
        """The same for many right sides, (b, 3f) float64, which read the factor once."""
        e = self.elimination
        x = np.ascontiguousarray(right.T, dtype=self.values.dtype)
        largest = int((np.diff(e.first) + np.diff(e.row_start)).max(initial=0))
        work = np.empty(3 * largest * len(right), dtype=x.dtype)
        _solve_columns(self.values, self._start, e.first, e.row_start, e.rows, x, work)
        return np.ascontiguousarray(x.T, dtype=np.float64)

    def _factorise(self, indptr: Indices, indices: Indices, blocks: Array, dtype: type) -> Numbers:
        e, start = self.elimination, self._start
        values = np.zeros(start[-1], dtype=dtype)
        tree = e.first, e.row_start, e.parent, e.entry_place, e.place
        fault = _factorise(indptr, indices, blocks, start, *tree, values)
        if fault:
            raise NotPositive(f"pivot {fault} is not positive")
        return values


def factor_bytes(elimination: Elimination) -> int:
    """Memory of a factor in double precision, with half as much again for the fronts while it is made."""
    return 12 * elimination.entries


@njit(cache=True, nogil=True)
def _factorise(
    indptr: Indices,
    indices: Indices,
    blocks: Array,
    start: Indices,
    first: Indices,
    row_start: Indices,
    parent: Indices,
    entry_place: Indices,
    place: Indices,
    values: Numbers,
) -> int:
    """L into `values`, one supernode after another; the number of the first pivot that is not positive, or 0.

    One compiled call for all fronts: a call for each took and gave back the interpreter's lock thousands of times, and
    two threads that factorise were slower than one.
    """
    supernodes = len(parent)
    child, sibling = children(parent)
    updates = [np.empty((0, 0), dtype=values.dtype) for _ in range(supernodes)]
    for s in range(supernodes):
        c, r = 3 * (first[s + 1] - first[s]), 3 * (row_start[s + 1] - row_start[s])
        middle = start[s] + c * c
        D = values[start[s] : middle].reshape((c, c)).T
        B = values[middle : start[s + 1]].reshape((c, r)).T
        own = np.zeros((r, r), dtype=values.dtype)
        _add_entries(indptr, indices, blocks, entry_place, first[s], first[s + 1], D, B)
        other = child[s]
        while other >= 0:
            _add_update(updates[other].T, place[row_start[other] : row_start[other + 1]], D, B, own.T)
            updates[other] = np.empty((0, 0), dtype=values.dtype)
            other = sibling[other]
        fault = potrf(D)
        if fault:
            return int(3 * first[s] + fault)
        if r:
            trsm(D, B)
            syrk(B, own.T)
            updates[s] = own
        trtri(D)
    return 0


@njit
def _add_entries(
    indptr: Indices, indices: Indices, blocks: Array, entry_place: Indices, begin: int, end: int, D: Numbers, B: Numbers
) -> None:
    """Adds the lower entries of columns begin … end − 1 to the front's diagonal block D and to B below it."""
    columns = end - begin
    for j in range(begin, end):
        q = 3 * (j - begin)
        for k in range(indptr[j], indptr[j + 1]):
            i = entry_place[k]
            if i < 0:
                continue
            if i < columns:
                for b in range(3):
                    for a in range(3):
                        D[3 * i + a, q + b] += blocks[k, b, a]
            else:
                for b in range(3):
                    for a in range(3):
                        B[3 * (i - columns) + a, q + b] += blocks[k, b, a]


@njit
def _add_update(update: Numbers, place: Indices, D: Numbers, B: Numbers, C: Numbers) -> None:
    """Adds the lower triangle of a child's update to the front (D, B, C) of its parent."""
    columns = D.shape[0] // 3
    for j in range(place.shape[0]):
        q = place[j]
        for b in range(3):
            for i in range(j, place.shape[0]):
                p = place[i]
                lowest = b if i == j else 0
                for a in range(lowest, 3):
                    value = update[3 * i + a, 3 * j + b]
                    if q >= columns:
                        C[3 * (p - columns) + a, 3 * (q - columns) + b] += value
                    elif p >= columns:
                        B[3 * (p - columns) + a, 3 * q + b] += value
                    else:
                        D[3 * p + a, 3 * q + b] += value


@njit(cache=True, nogil=True)
def _solve(
    values: Numbers, start: Indices, first: Indices, row_start: Indices, rows: Indices, x: Numbers, work: Numbers
) -> None:
    """A x = right, in place: down the supernodes with L, up again with Lᵀ; `work` is as long as the largest front."""
    supernodes = first.shape[0] - 1
    for s in range(supernodes):
        o, c, r = 3 * first[s], 3 * (first[s + 1] - first[s]), 3 * (row_start[s + 1] - row_start[s])
        middle = start[s] + c * c
        y, solved, w = x[o : o + c], work[:c], work[c : c + r]
        np.dot(y, values[start[s] : middle].reshape((c, c)), solved)
        y[:] = solved
        if r > 0:
            np.dot(y, values[middle : middle + c * r].reshape((c, r)), w)
            for i in range(r // 3):
                k = 3 * rows[row_start[s] + i]
                x[k] -= w[3 * i]
                x[k + 1] -= w[3 * i + 1]
                x[k + 2] -= w[3 * i + 2]
    for s in range(supernodes - 1, -1, -1):
        o, c, r = 3 * first[s], 3 * (first[s + 1] - first[s]), 3 * (row_start[s + 1] - row_start[s])
        middle = start[s] + c * c
        y, solved, w = x[o : o + c], work[:c], work[c : c + r]
        if r > 0:
            for i in range(r // 3):
                k = 3 * rows[row_start[s] + i]
                w[3 * i] = x[k]
                w[3 * i + 1] = x[k + 1]
                w[3 * i + 2] = x[k + 2]
            np.dot(values[middle : middle + c * r].reshape((c, r)), w, solved)
            for j in range(c):
                y[j] -= solved[j]
        np.dot(values[start[s] : middle].reshape((c, c)), y, solved)
        y[:] = solved


@njit(cache=True, nogil=True)
def _solve_columns(
    values: Numbers, start: Indices, first: Indices, row_start: Indices, rows: Indices, x: Numbers, work: Numbers
) -> None:
    """As `_solve`, for the columns of x, (3f, b); `work` holds b columns as long as the largest front."""
    supernodes, b = first.shape[0] - 1, x.shape[1]
    for s in range(supernodes):
        o, c, r = 3 * first[s], 3 * (first[s + 1] - first[s]), 3 * (row_start[s + 1] - row_start[s])
        middle = start[s] + c * c
        y, solved, w = x[o : o + c], work[: c * b].reshape((c, b)), work[c * b : (c + r) * b].reshape((r, b))
        np.dot(values[start[s] : middle].reshape((c, c)).T, y, solved)
        y[:] = solved
        if r > 0:
            np.dot(values[middle : middle + c * r].reshape((c, r)).T, y, w)
            for i in range(r):
                k = 3 * rows[row_start[s] + i // 3] + i % 3
                for j in range(b):
                    x[k, j] -= w[i, j]
    for s in range(supernodes - 1, -1, -1):
        o, c, r = 3 * first[s], 3 * (first[s + 1] - first[s]), 3 * (row_start[s + 1] - row_start[s])
        middle = start[s] + c * c
        y, solved, w = x[o : o + c], work[: c * b].reshape((c, b)), work[c * b : (c + r) * b].reshape((r, b))
        if r > 0:
            for i in range(r):
                k = 3 * rows[row_start[s] + i // 3] + i % 3
                for j in range(b):
                    w[i, j] = x[k, j]
            np.dot(values[middle : middle + c * r].reshape((c, r)), w, solved)
            for i in range(c):
                for j in range(b):
                    y[i, j] -= solved[i, j]
        np.dot(values[start[s] : middle].reshape((c, c)), y, solved)
        y[:] = solved
