"""3×3 tensor algebra on scalars for the compiled kernels: a matrix is a tuple of nine floats, row by row."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from ldsim.jit import njit

Matrix: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
Principal: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
Symmetric: TypeAlias = tuple[float, float, float, float, float, float]

SWEEPS = 12


@njit(cache=True, inline="always")
def determinant(A: Matrix) -> float:
    return A[0] * (A[4] * A[8] - A[5] * A[7]) - A[1] * (A[3] * A[8] - A[5] * A[6]) + A[2] * (A[3] * A[7] - A[4] * A[6])


@njit(cache=True, inline="always")
def combination(a: float, A: Matrix, b: float, B: Matrix) -> Matrix:
    """a A + b B."""
    return (
        a * A[0] + b * B[0],
        a * A[1] + b * B[1],
        a * A[2] + b * B[2],
        a * A[3] + b * B[3],
        a * A[4] + b * B[4],
        a * A[5] + b * B[5],
        a * A[6] + b * B[6],
        a * A[7] + b * B[7],
        a * A[8] + b * B[8],
    )


@njit(cache=True, inline="always")
def cofactor(A: Matrix) -> Matrix:
    """det(A) A^(−T), the derivative of the determinant."""
    return (
        A[4] * A[8] - A[5] * A[7],
        A[5] * A[6] - A[3] * A[8],
        A[3] * A[7] - A[4] * A[6],
        A[2] * A[7] - A[1] * A[8],
        A[0] * A[8] - A[2] * A[6],
        A[1] * A[6] - A[0] * A[7],
        A[1] * A[5] - A[2] * A[4],
        A[2] * A[3] - A[0] * A[5],
        A[0] * A[4] - A[1] * A[3],
    )


@njit(cache=True, inline="always")
def squared_norm(A: Matrix) -> float:
    return (
        A[0] * A[0] + A[1] * A[1] + A[2] * A[2]
        + A[3] * A[3] + A[4] * A[4] + A[5] * A[5]
        + A[6] * A[6] + A[7] * A[7] + A[8] * A[8]
    )  # fmt: skip


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


@njit(cache=True)
def signed_svd(F: Matrix) -> tuple[Matrix, tuple[float, float, float], Matrix]:
    """F = U diag(σ) Vᵀ with U and V rotations; the last σ carries the sign of det F.

    V diagonalises FᵀF; the columns of F V, made orthonormal in order of their length, are U.
    """
    l0, l1, l2, V = symmetric_eigen(
        (
            F[0] * F[0] + F[3] * F[3] + F[6] * F[6],
            F[1] * F[1] + F[4] * F[4] + F[7] * F[7],
            F[2] * F[2] + F[5] * F[5] + F[8] * F[8],
            F[0] * F[1] + F[3] * F[4] + F[6] * F[7],
            F[0] * F[2] + F[3] * F[5] + F[6] * F[8],
            F[1] * F[2] + F[4] * F[5] + F[7] * F[8],
        )
    )
    i, j = 0, 1
    if l1 > l0 and l1 >= l2:
        i, j = 1, 0 if l0 >= l2 else 2
    elif l2 > l0 and l2 > l1:
        i, j = 2, 0 if l0 >= l1 else 1
    elif l2 > l1:
        j = 2
    p0, p1, p2 = V[i], V[3 + i], V[6 + i]
    q0, q1, q2 = V[j], V[3 + j], V[6 + j]
    r0, r1, r2 = p1 * q2 - p2 * q1, p2 * q0 - p0 * q2, p0 * q1 - p1 * q0
    x0 = F[0] * p0 + F[1] * p1 + F[2] * p2
    x1 = F[3] * p0 + F[4] * p1 + F[5] * p2
    x2 = F[6] * p0 + F[7] * p1 + F[8] * p2
    y0 = F[0] * q0 + F[1] * q1 + F[2] * q2
    y1 = F[3] * q0 + F[4] * q1 + F[5] * q2
    y2 = F[6] * q0 + F[7] * q1 + F[8] * q2
    w0 = F[0] * r0 + F[1] * r1 + F[2] * r2
    w1 = F[3] * r0 + F[4] * r1 + F[5] * r2
    w2 = F[6] * r0 + F[7] * r1 + F[8] * r2
    s0 = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
    if s0 > 0.0:
        x0, x1, x2 = x0 / s0, x1 / s0, x2 / s0
    else:
        x0, x1, x2 = 1.0, 0.0, 0.0
    overlap = x0 * y0 + x1 * y1 + x2 * y2
    y0, y1, y2 = y0 - overlap * x0, y1 - overlap * x1, y2 - overlap * x2
    s1 = math.sqrt(y0 * y0 + y1 * y1 + y2 * y2)
    if s1 > 1e-14 * s0:
        y0, y1, y2 = y0 / s1, y1 / s1, y2 / s1
    elif abs(x0) < 0.8:
        scale = 1.0 / math.sqrt(x1 * x1 + x2 * x2)
        y0, y1, y2 = 0.0, x2 * scale, -x1 * scale
    else:
        scale = 1.0 / math.sqrt(x0 * x0 + x2 * x2)
        y0, y1, y2 = x2 * scale, 0.0, -x0 * scale
    z0, z1, z2 = x1 * y2 - x2 * y1, x2 * y0 - x0 * y2, x0 * y1 - x1 * y0
    s2 = z0 * w0 + z1 * w1 + z2 * w2
    U = (x0, y0, z0, x1, y1, z1, x2, y2, z2)
    return U, (s0, s1, s2), (p0, q0, r0, p1, q1, r1, p2, q2, r2)
