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
    """A routine in both precisions, as compiled code calls it: with the size of a number, and so many pointers."""
    both = []
    for letter in "sd":
        symbol = f"ldsim_{letter}{name}"
        address = get_cython_function_address(f"scipy.linalg.{module}", letter + name)
        llvmlite.binding.add_symbol(symbol, address)
        both.append(types.ExternalFunction(symbol, types.void(*[types.voidptr] * arguments)))
    single, double = both

    @njit
    def call(itemsize, *pointers):  # type: ignore[no-untyped-def]
        if itemsize == 8:
            double(*pointers)
        else:
            single(*pointers)

    return call


_potrf, _trtri = _routine("cython_lapack", "potrf", 5), _routine("cython_lapack", "trtri", 6)
_trsm, _syrk = _routine("cython_blas", "trsm", 11), _routine("cython_blas", "syrk", 10)


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
    _potrf(D.itemsize, lower.ctypes, n.ctypes, D.ctypes, n.ctypes, fault.ctypes)
    for j in range(1, D.shape[0]):
        for i in range(j):
            D[i, j] = 0
    return int(fault[0])


@njit
def trtri(D: Numbers) -> None:
    """D ← D⁻¹ of a lower triangle."""
    lower, plain, n, fault = _letter("L"), _letter("N"), _number(D.shape[0]), _number(0)
    _trtri(D.itemsize, lower.ctypes, plain.ctypes, n.ctypes, D.ctypes, n.ctypes, fault.ctypes)


@njit
def trsm(L: Numbers, B: Numbers) -> None:
    """B ← B L⁻ᵀ."""
    right, lower, turned, plain = _letter("R"), _letter("L"), _letter("T"), _letter("N")
    rows, columns, one = _number(B.shape[0]), _number(B.shape[1]), np.ones(1, dtype=B.dtype)
    _trsm(
        B.itemsize, right.ctypes, lower.ctypes, turned.ctypes, plain.ctypes, rows.ctypes, columns.ctypes, one.ctypes,
        L.ctypes, columns.ctypes, B.ctypes, rows.ctypes,
    )  # fmt: skip


@njit
def syrk(B: Numbers, C: Numbers) -> None:
    """C ← C − B Bᵀ, its lower triangle."""
    lower, plain, n, k = _letter("L"), _letter("N"), _number(B.shape[0]), _number(B.shape[1])
    one = np.ones(1, dtype=B.dtype)
    minus = -one
    _syrk(
        B.itemsize, lower.ctypes, plain.ctypes, n.ctypes, k.ctypes, minus.ctypes, B.ctypes, n.ctypes, one.ctypes,
        C.ctypes, n.ctypes,
    )  # fmt: skip
