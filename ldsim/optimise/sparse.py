"""Direct factorisation of sparse symmetric positive definite matrices of 3×3 blocks: multifrontal Cholesky.

Duff and Reid 1983, "The multifrontal solution of indefinite sparse symmetric linear equations". METIS orders, LAPACK
factorises the dense fronts; what is here only moves numbers between them. SciPy's SuperLU treats the matrix as
unsymmetric: on the X of 29,686 tets it took four times as long to factorise and twice as long to solve.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk, dtrsm, ssyrk, strsm
from scipy.linalg.lapack import dpotrf, dtrtri, spotrf, strtri

from ldsim.arrays import Array, Indices
from ldsim.errors import SolverError
from ldsim.jit import njit
from ldsim.optimise.elimination import Elimination

# float32 or float64, by the precision of the factor.
Numbers: TypeAlias = NDArray[Any]


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
                "check that every part of the solid is pinned or the time step is positive"
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

    def _factorise(self, indptr: Indices, indices: Indices, blocks: Array, dtype: type) -> Numbers:
        e, start = self.elimination, self._start
        single, double = (spotrf, strsm, ssyrk, strtri), (dpotrf, dtrsm, dsyrk, dtrtri)
        potrf, trsm, syrk, trtri = single if dtype is np.float32 else double
        values = np.zeros(start[-1], dtype=dtype)
        updates: list[list[tuple[int, Numbers]]] = [[] for _ in e.parent]
        for s, parent in enumerate(e.parent.tolist()):
            c = 3 * int(e.first[s + 1] - e.first[s])
            r = 3 * int(e.row_start[s + 1] - e.row_start[s])
            middle = start[s] + c * c
            D = values[start[s] : middle].reshape((c, c), order="F")
            B = values[middle : start[s + 1]].reshape((r, c), order="F")
            C: Numbers = np.zeros((r, r), dtype=dtype, order="F")
            _add_entries(indptr, indices, blocks, e.entry_place, e.first[s], e.first[s + 1], D, B)
            for child, update in updates[s]:
                _add_update(update, e.place[e.row_start[child] : e.row_start[child + 1]], D, B, C)
            updates[s] = []
            _, fault = potrf(D, lower=1, clean=1, overwrite_a=1)
            if fault:
                raise NotPositive(f"pivot {3 * int(e.first[s]) + fault} is not positive")
            if r:
                trsm(1.0, D, B, side=1, lower=1, trans_a=1, overwrite_b=1)
                updates[parent].append((s, syrk(-1.0, B, beta=1.0, c=C, lower=1, overwrite_c=1)))
            trtri(D, lower=1, overwrite_c=1)
        return values


def factor_bytes(elimination: Elimination) -> int:
    """Memory of a factor in double precision, with half as much again for the fronts while it is made."""
    return 12 * elimination.entries


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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
