"""The compiled materials by number: energy, stress and tangent of one point, energy and stresses of many.

A new material needs no change here: what is compiled follows from the list of names.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.jit import kernel, njit
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.materials.tensors import Matrix, Symmetric

Compiled = Callable[..., Any]

FILES = tuple(import_module(f"ldsim.mechanics.materials.{name}") for name in MATERIALS)
# Sums over points may be taken in another order, which lets the compiler do four points at once. The full space and
# the tangents are strict: their results are stored, and compared bit for bit.
REASSOCIATE = {"reassoc", "contract", "nsz"}


def by_number(functions: Iterable[Compiled]) -> Compiled:
    """A compiled function of a number n and more arguments, which calls the n-th of some compiled functions with them.

    Numba has no table of functions whose calls it can optimise, so this is a chain of comparisons. Its links need no
    cache of their own: the cached kernels that call them contain them.
    """
    choose: Compiled | None = None
    for number, function in reversed(list(enumerate(functions))):
        choose = _link(number, function, choose)
    assert choose is not None, "there are materials"
    return choose


def _link(number: int, function: Compiled, otherwise: Compiled | None) -> Compiled:
    @kernel(cache=False, forceinline=True)
    def choose(kind, *args):  # type: ignore[no-untyped-def]
        if kind == number:
            return function(*args)
        if otherwise is not None:
            return otherwise(kind, *args)
        # no scene can be made with such a number; should one get here, no other material takes its place
        raise ValueError("no material has this number")

    return choose


@njit(cache=True, inline="always")
def deformation(strain: Array, s: int) -> Matrix:
    """F = I + strain of point s; strain is (9, c)."""
    return (
        1.0 + strain[0, s], strain[1, s], strain[2, s],
        strain[3, s], 1.0 + strain[4, s], strain[5, s],
        strain[6, s], strain[7, s], 1.0 + strain[8, s],
    )  # fmt: skip


@njit(cache=True, inline="always")
def _put(P: Matrix, w: float, out: Array, s: int) -> None:
    out[0, s], out[1, s], out[2, s] = w * P[0], w * P[1], w * P[2]
    out[3, s], out[4, s], out[5, s] = w * P[3], w * P[4], w * P[5]
    out[6, s], out[7, s], out[8, s] = w * P[6], w * P[7], w * P[8]


def _summed(energy_stress: Compiled) -> Compiled:
    """The loop of `weighted_stresses` over points of one material."""
    # written into the loop, not called from it: only so may its sums be taken in another order
    inlined = njit(inline="always")(energy_stress.py_func)  # type: ignore[attr-defined]

    @kernel(cache=False, error_model="numpy", fastmath=REASSOCIATE)
    def add(start: int, stop: int, strain: Array, weights: Array, mu: Array, lam: Array) -> float:
        total = 0.0
        # One loop for one material: a choice inside keeps the points from going four at a time. A loop over all columns
        # goes four at a time from 12 points on, for the compiler sees that rows do not overlap; a shorter one from 16.
        if stop - start == strain.shape[1]:
            for s in range(strain.shape[1]):
                density, P = inlined(deformation(strain, s), mu[s], lam[s])
                total += weights[s] * density
                _put(P, weights[s], strain, s)
            return total
        # Unsigned, because a signed index may count from the end, and finding that out for each point took as long
        # as the material does.
        for s in range(np.uint64(start), np.uint64(stop)):
            density, P = inlined(deformation(strain, s), mu[s], lam[s])
            total += weights[s] * density
            _put(P, weights[s], strain, s)
        return total

    return add


_stress = by_number([njit(forceinline=True)(file.energy_stress.py_func) for file in FILES])
_tangent = by_number([file.tangent for file in FILES])
_sum = by_number([_summed(file.energy_stress) for file in FILES])


@njit(cache=True)
def energy_stress(kind: int, F: Matrix, mu: float, lam: float) -> tuple[float, Matrix]:
    """Energy density Ψ(F), J/m³, and the first Piola–Kirchhoff stress P = ∂Ψ/∂F, Pa.

    Args:
        kind: number of the material.
        mu, lam: its Lamé parameters, Pa.
    """
    density, P = _stress(kind, F, mu, lam)
    return density, P


@njit(cache=True)
def energy(kind: int, F: Matrix, mu: float, lam: float) -> float:
    """Ψ(F) alone; the compiler drops what only the stress needs."""
    density, _ = _stress(kind, F, mu, lam)
    return float(density)


@njit(cache=True)
def tangent(kind: int, F: Matrix, mu: float, lam: float, clamp: bool) -> tuple[Matrix, Matrix, Symmetric, Symmetric]:
    """The tangent ∂²Ψ/∂F², Pa, in a frame X = Uᵀ dF V where it is sparse: that of the singular vectors, if isotropic.

    Returns U, V, the stretch block ∂²Ψ/∂X_ii∂X_jj as (00, 11, 22, 01, 02, 12), and the three off-diagonal pairs as
    (a01, a02, a12, b01, b02, b12): a_ij = ∂²Ψ/∂X_ij² = ∂²Ψ/∂X_ji², b_ij = ∂²Ψ/∂X_ij∂X_ji; everything else is zero.
    With `clamp`, negative eigenvalues are set to zero (Smith et al. 2019, Sec. 5).
    """
    U, V, stretch, pairs = _tangent(kind, F, mu, lam, clamp)
    return U, V, stretch, pairs


@kernel()
def weighted_stresses(kind: NDArray[np.int8], strain: Array, weights: Array, mu: Array, lam: Array) -> float:
    """Σ w Ψ(I + strain), J, of c points; `strain` (9, c) is overwritten by w P. Infinite where one density is.

    The material is chosen once for each run of points of one kind, so points sorted by kind are fastest.
    """
    count = kind.shape[0]
    mixed = False
    for s in range(count):  # without a way out, so that it costs nothing beside the materials
        mixed |= kind[s] != kind[0]
    total, stop = 0.0, 0
    while stop < count:
        start, stop = stop, stop + 1 if mixed else count
        while stop < count and kind[stop] == kind[start]:
            stop += 1
        total += _sum(kind[start], start, stop, strain, weights, mu, lam)
    # NaN, as of a density ∞ − ∞, is not less than anything either
    return total if total < math.inf else math.inf
