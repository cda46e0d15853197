"""3×3 tensor algebra on scalars for the compiled kernels: a matrix is a tuple of nine floats, row by row."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from ldsim.jit import njit

Matrix: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
Vector: TypeAlias = tuple[float, float, float]
Symmetric: TypeAlias = tuple[float, float, float, float, float, float]

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
# Of Jacobi's method, which is done after three to five; one that is handed NaN ends as well.
SWEEPS = 12


@njit(cache=True, inline="always")
def determinant(A: Matrix) -> float:
    return A[0] * (A[4] * A[8] - A[5] * A[7]) - A[1] * (A[3] * A[8] - A[5] * A[6]) + A[2] * (A[3] * A[7] - A[4] * A[6])


@njit(cache=True, inline="always")
def combination(a: float, A: Matrix, b: float, B: Matrix) -> Matrix:
    """a A + b B."""
    return (
        a * A[0] + b * B[0], a * A[1] + b * B[1], a * A[2] + b * B[2],
        a * A[3] + b * B[3], a * A[4] + b * B[4], a * A[5] + b * B[5],
        a * A[6] + b * B[6], a * A[7] + b * B[7], a * A[8] + b * B[8],
    )  # fmt: skip


@njit(cache=True, inline="always")
def product(A: Matrix, B: Matrix) -> Matrix:
    """A B."""
    return (*_row(A[0], A[1], A[2], B), *_row(A[3], A[4], A[5], B), *_row(A[6], A[7], A[8], B))


@njit(cache=True, inline="always")
def _row(x: float, y: float, z: float, B: Matrix) -> Vector:
    """(x, y, z) B."""
    return x * B[0] + y * B[3] + z * B[6], x * B[1] + y * B[4] + z * B[7], x * B[2] + y * B[5] + z * B[8]


@njit(cache=True, inline="always")
def product_transposed(A: Matrix, B: Matrix) -> Matrix:
    """A Bᵀ."""
    return product(A, (B[0], B[3], B[6], B[1], B[4], B[7], B[2], B[5], B[8]))


@njit(cache=True, inline="always")
def gram(F: Matrix) -> Symmetric:
    """FᵀF as (00, 11, 22, 01, 02, 12)."""
    return (
        F[0] * F[0] + F[3] * F[3] + F[6] * F[6],
        F[1] * F[1] + F[4] * F[4] + F[7] * F[7],
        F[2] * F[2] + F[5] * F[5] + F[8] * F[8],
        F[0] * F[1] + F[3] * F[4] + F[6] * F[7],
        F[0] * F[2] + F[3] * F[5] + F[6] * F[8],
        F[1] * F[2] + F[4] * F[5] + F[7] * F[8],
    )


@njit(cache=True, inline="always")
def cofactor(A: Matrix) -> Matrix:
    """det(A) A^(−T), the derivative of the determinant."""
    return (
        A[4] * A[8] - A[5] * A[7], A[5] * A[6] - A[3] * A[8], A[3] * A[7] - A[4] * A[6],
        A[2] * A[7] - A[1] * A[8], A[0] * A[8] - A[2] * A[6], A[1] * A[6] - A[0] * A[7],
        A[1] * A[5] - A[2] * A[4], A[2] * A[3] - A[0] * A[5], A[0] * A[4] - A[1] * A[3],
    )  # fmt: skip


@njit(cache=True, inline="always")
def inner(A: Matrix, B: Matrix) -> float:
    """A : B, the sum of the products of their entries."""
    return (
        A[0] * B[0] + A[1] * B[1] + A[2] * B[2]
        + A[3] * B[3] + A[4] * B[4] + A[5] * B[5]
        + A[6] * B[6] + A[7] * B[7] + A[8] * B[8]
    )  # fmt: skip


@njit(cache=True, inline="always")
def squared_norm(A: Matrix) -> float:
    return inner(A, A)


@njit(cache=True, inline="always")
def inverse_cube_root(x: float) -> float:
    """x^(−1/3) for x > 0, to a few units in the last place; without a branch or a call. Any number elsewhere.

    With b the bits of x, four thirds of those of 1 (a little less, to balance the error) minus b/3 = Σ b/4ⁱ are those
    of a guess that is 3.4 % off at most; five steps of Newton's method on y⁻³ = x follow.
    """
    bits = np.float64(x).view(np.int64)
    third = (bits >> np.int64(2)) + (bits >> np.int64(4))
    third = third + (third >> np.int64(4))
    third = third + (third >> np.int64(8))
    third = third + (third >> np.int64(16))
    y = np.int64(np.int64(0x553EF0FF289DD796) - third).view(np.float64)
    y += y * (1.0 - x * y * y * y) * (1.0 / 3.0)
    y += y * (1.0 - x * y * y * y) * (1.0 / 3.0)
    y += y * (1.0 - x * y * y * y) * (1.0 / 3.0)
    y += y * (1.0 - x * y * y * y) * (1.0 / 3.0)
    y += y * (1.0 - x * y * y * y) * (1.0 / 3.0)
    return float(y)


@njit(cache=True)
def jacobi_rotation(app: float, aqq: float, apq: float) -> tuple[float, float, float]:
    """Cosine, sine and tangent of the rotation that zeroes the off-diagonal apq (Golub and Van Loan, Sec. 8.5)."""
    if apq == 0.0:
        return 1.0, 0.0, 0.0
    tau = (aqq - app) / (2.0 * apq)
    t = math.copysign(1.0, tau) / (abs(tau) + math.sqrt(1.0 + tau * tau))
    c = 1.0 / math.sqrt(1.0 + t * t)
    return c, t * c, t


@njit(cache=True)
def symmetric_eigen(S: Symmetric) -> tuple[float, float, float, Matrix]:
    """Eigenvalues and the rotation V of eigenvectors (columns) of S = (s00, s11, s22, s01, s02, s12), by Jacobi."""
    a, b, c, d, e, f = S
    v00, v01, v02, v10, v11, v12, v20, v21, v22 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for _ in range(SWEEPS):
        if abs(d) + abs(e) + abs(f) <= 1e-17 * (abs(a) + abs(b) + abs(c)):
            break
        cs, sn, t = jacobi_rotation(a, b, d)
        a, b, d = a - t * d, b + t * d, 0.0
        e, f = cs * e - sn * f, sn * e + cs * f
        v00, v01 = cs * v00 - sn * v01, sn * v00 + cs * v01
        v10, v11 = cs * v10 - sn * v11, sn * v10 + cs * v11
        v20, v21 = cs * v20 - sn * v21, sn * v20 + cs * v21
        cs, sn, t = jacobi_rotation(a, c, e)
        a, c, e = a - t * e, c + t * e, 0.0
        d, f = cs * d - sn * f, sn * d + cs * f
        v00, v02 = cs * v00 - sn * v02, sn * v00 + cs * v02
        v10, v12 = cs * v10 - sn * v12, sn * v10 + cs * v12
        v20, v22 = cs * v20 - sn * v22, sn * v20 + cs * v22
        cs, sn, t = jacobi_rotation(b, c, f)
        b, c, f = b - t * f, c + t * f, 0.0
        d, e = cs * d - sn * e, sn * d + cs * e
        v01, v02 = cs * v01 - sn * v02, sn * v01 + cs * v02
        v11, v12 = cs * v11 - sn * v12, sn * v11 + cs * v12
        v21, v22 = cs * v21 - sn * v22, sn * v21 + cs * v22
    return a, b, c, (v00, v01, v02, v10, v11, v12, v20, v21, v22)


@njit(cache=True, inline="always")
def _positive(S: Symmetric) -> bool:
    """Whether the leading minors of S are positive (Sylvester's criterion), by more than their rounding."""
    a, b, c, d, e, f = S
    minor = a * b - d * d
    third = minor * c - (a * f * f - 2.0 * d * e * f + b * e * e)
    return a > 0.0 and minor > 1e-14 * a * b and third > 1e-14 * a * b * c


@njit(cache=True)
def clamped_symmetric(S: Symmetric) -> Symmetric:
    """The nearest positive semidefinite matrix: negative eigenvalues set to zero."""
    if _positive(S):
        return S
    a, b, c, V = symmetric_eigen(S)
    if a >= 0.0 and b >= 0.0 and c >= 0.0:
        return S
    a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
    return (
        a * V[0] * V[0] + b * V[1] * V[1] + c * V[2] * V[2],
        a * V[3] * V[3] + b * V[4] * V[4] + c * V[5] * V[5],
        a * V[6] * V[6] + b * V[7] * V[7] + c * V[8] * V[8],
        a * V[0] * V[3] + b * V[1] * V[4] + c * V[2] * V[5],
        a * V[0] * V[6] + b * V[1] * V[7] + c * V[2] * V[8],
        a * V[3] * V[6] + b * V[4] * V[7] + c * V[5] * V[8],
    )


@njit(cache=True, inline="always")
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, inline="always")
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, inline="always")
def _times(A: Matrix, x: Vector) -> Vector:
    return _dot((A[0], A[1], A[2]), x), _dot((A[3], A[4], A[5]), x), _dot((A[6], A[7], A[8]), x)


@njit(cache=True)
def signed_svd(F: Matrix) -> tuple[Matrix, Vector, Matrix]:
    """F = U diag(σ) Vᵀ with U and V rotations; the last σ carries the sign of det F.

    V diagonalises FᵀF; the columns of F V, made orthonormal in order of their length, are U.
    """
    l0, l1, l2, V = symmetric_eigen(gram(F))
    # the columns of the largest and the second stretch; the third follows as their cross product
    i, j = 0, 1
    if l1 > l0 and l1 >= l2:
        i, j = 1, 0 if l0 >= l2 else 2
    elif l2 > l0 and l2 > l1:
        i, j = 2, 0 if l0 >= l1 else 1
    elif l2 > l1:
        j = 2
    p, q = (V[i], V[3 + i], V[6 + i]), (V[j], V[3 + j], V[6 + j])
    r = _cross(p, q)
    x, y = _times(F, p), _times(F, q)
    s0 = math.sqrt(_dot(x, x))
    x = (x[0] / s0, x[1] / s0, x[2] / s0) if s0 > 0.0 else (1.0, 0.0, 0.0)
    overlap = _dot(x, y)
    y = (y[0] - overlap * x[0], y[1] - overlap * x[1], y[2] - overlap * x[2])
    s1 = math.sqrt(_dot(y, y))
    # a solid crushed to a line leaves no second direction: any one across the first will do
    if s1 > 1e-14 * s0:
        y = (y[0] / s1, y[1] / s1, y[2] / s1)
    elif abs(x[0]) < 0.8:
        scale = 1.0 / math.sqrt(x[1] * x[1] + x[2] * x[2])
        y = (0.0, x[2] * scale, -x[1] * scale)
    else:
        scale = 1.0 / math.sqrt(x[0] * x[0] + x[2] * x[2])
        y = (x[2] * scale, 0.0, -x[0] * scale)
    z = _cross(x, y)
    s2 = _dot(z, _times(F, r))
    U = (x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2])
    return U, (s0, s1, s2), (p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2])
