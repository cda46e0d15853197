"""Four routines of SciPy's own BLAS and LAPACK for compiled loops, in both precisions, by the names of the reference.

Numba's linear algebra copies what it is given and has neither triangular solves nor rank-k updates. SciPy publishes
the addresses of its library (scipy.linalg.cython_blas, cython_lapack); calls by name leave compiled code cacheable.
Matrices are column-major, lower triangles; each call works in place.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding
import numpy as np
from numba import types
from numba.extending import get_cython_function_address

from ldsim.arrays import Numbers
from ldsim.jit import njit


def _routine(module: str, name: str, arguments: int) -> Any:
    """A routine that takes so many pointers, as compiled code calls it."""
    symbol = f"ldsim_{name}"
    llvmlite.binding.add_symbol(symbol, get_cython_function_address(f"scipy.linalg.{module}", name))
    return types.ExternalFunction(symbol, types.void(*[types.voidptr] * arguments))


_dpotrf, _spotrf = (_routine("cython_lapack", name, 5) for name in ("dpotrf", "spotrf"))
_dtrtri, _strtri = (_routine("cython_lapack", name, 6) for name in ("dtrtri", "strtri"))
_dtrsm, _strsm = (_routine("cython_blas", name, 11) for name in ("dtrsm", "strsm"))
_dsyrk, _ssyrk = (_routine("cython_blas", name, 10) for name in ("dsyrk", "ssyrk"))


@njit
def _letter(code: str) -> Numbers:
    return np.array([ord(code)], dtype=np.uint8)


@njit
def _number(n: int) -> Numbers:
    return np.array([n], dtype=np.int32)


@njit
def potrf(D: Numbers) -> int:
    """D ← L with L Lᵀ = D; the upper triangle is set to zero. The first pivot, from 1, that is not positive, or 0."""
    lower, n, fault = _letter("L"), _number(D.shape[0]), _number(0)
    if D.itemsize == 8:
        _dpotrf(lower.ctypes, n.ctypes, D.ctypes, n.ctypes, fault.ctypes)
    else:
        _spotrf(lower.ctypes, n.ctypes, D.ctypes, n.ctypes, fault.ctypes)
    for j in range(1, D.shape[0]):
        for i in range(j):
            D[i, j] = 0
    return int(fault[0])


@njit
def trtri(D: Numbers) -> None:
    """D ← D⁻¹ of a lower triangle."""
    lower, plain, n, fault = _letter("L"), _letter("N"), _number(D.shape[0]), _number(0)
    if D.itemsize == 8:
        _dtrtri(lower.ctypes, plain.ctypes, n.ctypes, D.ctypes, n.ctypes, fault.ctypes)
    else:
        _strtri(lower.ctypes, plain.ctypes, n.ctypes, D.ctypes, n.ctypes, fault.ctypes)


@njit
def trsm(L: Numbers, B: Numbers) -> None:
    """B ← B L⁻ᵀ."""
    right, lower, turned, plain = _letter("R"), _letter("L"), _letter("T"), _letter("N")
    rows, columns, one = _number(B.shape[0]), _number(B.shape[1]), np.ones(1, dtype=B.dtype)
    if B.itemsize == 8:
        _dtrsm(
            right.ctypes, lower.ctypes, turned.ctypes, plain.ctypes, rows.ctypes, columns.ctypes, one.ctypes, L.ctypes,
            columns.ctypes, B.ctypes, rows.ctypes,
        )  # fmt: skip
    else:
        _strsm(
            right.ctypes, lower.ctypes, turned.ctypes, plain.ctypes, rows.ctypes, columns.ctypes, one.ctypes, L.ctypes,
            columns.ctypes, B.ctypes, rows.ctypes,
        )  # fmt: skip


@njit
def syrk(B: Numbers, C: Numbers) -> None:
    """C ← C − B Bᵀ, its lower triangle."""
    lower, plain, n, k = _letter("L"), _letter("N"), _number(B.shape[0]), _number(B.shape[1])
    one = np.ones(1, dtype=B.dtype)
    minus = -one
    if B.itemsize == 8:
        _dsyrk(
            lower.ctypes, plain.ctypes, n.ctypes, k.ctypes, minus.ctypes, B.ctypes, n.ctypes, one.ctypes, C.ctypes,
            n.ctypes,
        )  # fmt: skip
    else:
        _ssyrk(
            lower.ctypes, plain.ctypes, n.ctypes, k.ctypes, minus.ctypes, B.ctypes, n.ctypes, one.ctypes, C.ctypes,
            n.ctypes,
        )  # fmt: skip
