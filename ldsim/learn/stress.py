"""The stress of stable neo-Hookean points and its change, and the gradient of a loss through them.

Ψ is Eq. 14 of Smith et al. 2018 with the Lamé parameters of small strains (Sec. 3.4).
"""

from __future__ import annotations

import numpy as np

from ldsim.arrays import Numbers
from ldsim.jit import kernel, njit
from ldsim.mechanics.materials.tensors import Matrix, cofactor, combination, inner, squared_norm

# It stays finite where a point is inverted, and grows on: of a material that does not, a fit may put a wall where no
# sample has been, and the model's own runs never come to what lies behind it.
MATERIAL = "stable_neo_hookean"


def stresses(strains: Numbers, ratio: Numbers) -> Numbers:
    """P/μ at F = I + strain of c points, and below it what it changes by when F changes, (2b, 9c).

    Args:
        strains: of b poses, and below them as many changes, (2b, 9c).
        ratio: λ/μ, (c,), which is not learned.
    """
    found = np.empty_like(strains)
    _forwards(strains, ratio, found)
    return found


def stresses_adjoint(strains: Numbers, ratio: Numbers, counted: Numbers) -> Numbers:
    """The gradient of a loss by the strains, (2b, 9c), from that by `stresses` of them."""
    found = np.empty_like(strains)
    _backwards(strains, ratio, counted, found)
    return found


@njit(cache=True, inline="always")
def _read(rows: Numbers, i: int, s: int) -> Matrix:
    o = 9 * s
    return (
        rows[i, o], rows[i, o + 1], rows[i, o + 2],
        rows[i, o + 3], rows[i, o + 4], rows[i, o + 5],
        rows[i, o + 6], rows[i, o + 7], rows[i, o + 8],
    )  # fmt: skip


@njit(cache=True, inline="always")
def _write(A: Matrix, rows: Numbers, i: int, s: int) -> None:
    o = 9 * s
    rows[i, o], rows[i, o + 1], rows[i, o + 2] = A[0], A[1], A[2]
    rows[i, o + 3], rows[i, o + 4], rows[i, o + 5] = A[3], A[4], A[5]
    rows[i, o + 6], rows[i, o + 7], rows[i, o + 8] = A[6], A[7], A[8]


@njit(cache=True, inline="always")
def _mixed(A: Matrix, B: Matrix) -> Matrix:
    """The change of the cofactor of A along B, or that of B along A: it is quadratic."""
    return combination(0.5, cofactor(combination(1.0, A, 1.0, B)), -0.5, cofactor(combination(1.0, A, -1.0, B)))


@njit(cache=True, inline="always")
def _at(strains: Numbers, i: int, s: int, ratio: float) -> tuple[Matrix, Matrix, float, float, float, float]:
    """F, its cofactor, the shares of both in P, λ' and 1 / (I₁ + 1)."""
    F = combination(1.0, _read(strains, i, s), 1.0, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    C, lam, inverse = cofactor(F), ratio + 5.0 / 6.0, 1.0 / (squared_norm(F) + 1.0)
    J = F[0] * C[0] + F[1] * C[1] + F[2] * C[2]
    return F, C, 4.0 / 3.0 * (1.0 - inverse), lam * (J - 1.0) - 1.0, lam, inverse


@njit(cache=True, inline="always")
def _changed(
    F: Matrix, C: Matrix, shear: float, volume: float, lam: float, inverse: float, D: Matrix, M: Matrix
) -> Matrix:
    """∂²Ψ/∂F² D, where M is the change of the cofactor along D."""
    straight = combination(shear, D, 8.0 / 3.0 * inverse**2 * inner(F, D), F)
    return combination(1.0, straight, 1.0, combination(lam * inner(C, D), C, volume, M))


@kernel(error_model="numpy")
def _forwards(strains: Numbers, ratio: Numbers, out: Numbers) -> None:
    b = strains.shape[0] // 2
    for i in range(b):
        for s in range(ratio.shape[0]):
            F, C, shear, volume, lam, inverse = _at(strains, i, s, ratio[s])
            D = _read(strains, b + i, s)
            _write(combination(shear, F, volume, C), out, i, s)
            _write(_changed(F, C, shear, volume, lam, inverse, D, _mixed(F, D)), out, b + i, s)


@kernel(error_model="numpy")
def _backwards(strains: Numbers, ratio: Numbers, wanted: Numbers, out: Numbers) -> None:
    """Σ wanted · ∂(P, dP)/∂(F, D). With p and q wanted of P and of its change H D: H q for D, and for F
    H p + ∂(q : H D)/∂F."""
    b = strains.shape[0] // 2
    for i in range(b):
        for s in range(ratio.shape[0]):
            F, C, shear, volume, lam, inverse = _at(strains, i, s, ratio[s])
            D, p, q = _read(strains, b + i, s), _read(wanted, i, s), _read(wanted, b + i, s)
            along, other = _mixed(F, D), _mixed(F, q)
            _write(_changed(F, C, shear, volume, lam, inverse, q, other), out, b + i, s)
            square, FD, Fq = 8.0 / 3.0 * inverse**2, inner(F, D), inner(F, q)
            # the change of the part of the shear, then that of the volume: J is cubic in F
            part = combination(square * (inner(q, D) - 4.0 * inverse * FD * Fq), F, square * Fq, D)
            part = combination(1.0, part, square * FD, q)
            grown = combination(lam * inner(q, along), C, lam * inner(C, q), along)
            grown = combination(1.0, grown, lam * inner(C, D), other)
            grown = combination(1.0, grown, volume, _mixed(D, q))
            third = combination(1.0, part, 1.0, grown)
            _write(
                combination(1.0, third, 1.0, _changed(F, C, shear, volume, lam, inverse, p, _mixed(F, p))), out, i, s
            )
