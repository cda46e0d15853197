"""The springs of grabs in a condensed space: in series with its residual compliance, which warps with the solid.

A spring that pulls at the centroid of some vertices acts in series with C (space/compliance.py), which is known at
rest. Where the solid is held it may have turned by then: what was soft across a rod is soft across it still. So a force
is turned back, C at rest is applied, and what that moves is turned again, C ≈ A C₀ Aᵀ with one A = R a grab, as warping
does to stiffness (Müller et al. 2002, "Stable real-time deformations"); and what is stretched gives way further, so A =
R U^½ of the deformation gradient F = R U around it (`space.compliance.warp`). It is that of the state in which a step
begins.

The spring holds the solid by the end of the dent x = A d that it makes, and A d moves with q as well: that is a lever
on which the force turns and stretches the solid, H = ∂(A d)/∂q at fixed d. With L_j = ∂F/∂q_j F⁻¹, to first order in
the stretch, ∂A/∂q_j = (skew L_j + ½ sym L_j) A, so H_j = (¾ L_j − ¼ L_jᵀ) x.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.reduced.minimiser import cholesky
from ldsim.dynamics.reduced.potential import Springs
from ldsim.jit import kernel
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.materials.tensors import Matrix, product_transposed, signed_svd
from ldsim.space.compliance import LEAST_STRETCH
from ldsim.space.decoder import REASSOCIATE
from ldsim.space.space import Space


class InSeries(NamedTuple):
    """What some grabs have as long as they hold the same vertices.

    B (3g, k) and centre (3g,): c(q) = centre + B q, metres, of all centroids. compliance (3g, 3g): B C Bᵀ at rest, m/N.
    softness (3g,): 1/k. gradient (g, 3, 3, k): F = I + gradient q of the cells around (`Compliance.arms`). target
    (3g,): metres, to be written. Written by `warp_springs`: A and F⁻¹ of each grab, warps and inverses (g, 3, 3); dents
    (3g,), metres; levers (3g, k), B + H; base (3g,), what the centre is then, metres; the pull (3g, 3g) = L⁻ᵀ, which
    makes forces, N, of the stretch of the unit springs, and factor (3g, 3g), of L.
    """

    B: Array
    centre: Array
    compliance: Array
    softness: Array
    gradient: Array
    target: Array
    warps: Array
    inverses: Array
    dents: Array
    levers: Array
    base: Array
    pull: Array
    factor: Array

    @classmethod
    def none(cls, k: int) -> InSeries:
        """Where there is no grab, or no compliance."""
        shapes = (0, k), (0,), (0, 0), (0,), (0, 3, 3, k)
        return cls(*map(np.zeros, shapes), *_written(0, k))

    @classmethod
    def of(cls, space: Space, grabs: Sequence[Grab], gravity: Array | None) -> InSeries:
        """Those of a condensed space under some gravity, the scene's where it is left out."""
        compliance = space.compliance
        assert compliance is not None
        U, rest, held = space.reduced_basis.fields, space.scene.mesh.vertices, [grab.vertices for grab in grabs]
        sunk = rest + compliance.sag(gravity)
        arms = [compliance.arms(vertices) for vertices in held]
        near = [np.flatnonzero(each.any(axis=1)) for each in arms]
        gradient = [np.einsum("vik,vj->ijk", U[some], each[some]) for some, each in zip(near, arms, strict=True)]
        return cls(
            np.concatenate([U[vertices].mean(axis=0) for vertices in held]),
            np.concatenate([sunk[vertices].mean(axis=0) for vertices in held]),
            compliance.between(held),
            np.repeat([1 / grab.stiffness for grab in grabs], 3),
            np.stack(gradient),
            *_written(len(held), U.shape[2]),
        )


def _written(count: int, k: int) -> list[Array]:
    """Room for the target and for all that `warp_springs` writes, of some grabs."""
    n = 3 * count
    shapes = (n,), (count, 3, 3), (count, 3, 3), (n,), (n, k), (n,), (n, n), (n, n)
    return [np.zeros(shape) for shape in shapes]


@kernel()
def warp_springs(series: InSeries, q: Array, springs: Springs) -> None:
    """Write the springs, and all else that the series says, for a state with coordinates q, (k,).

    Their energy ½ pᵀ (diag(1/k) + A B C Bᵀ Aᵀ)⁻¹ p couples all grabs. With the Cholesky factor L of what is inverted it
    is ½ ‖L⁻¹ p‖²: springs of unit stiffness on L⁻¹ B, which the kernel of a step knows.
    """
    count, n, L, pull = series.warps.shape[0], series.softness.shape[0], series.factor, series.pull
    for g in range(count):
        _warp(series, g, q)
    for g in range(count):
        for h in range(g + 1):
            _warped_pair(series, g, h, L)
    for i in range(n):
        L[i, i] += series.softness[i]
    cholesky(L)
    for i in range(n):
        for j in range(n):
            pull[j, i] = 1.0 if i == j else 0.0
        for j in range(i):
            for h in range(j + 1):
                pull[h, i] -= L[i, j] * pull[h, j]
        for h in range(i + 1):
            pull[h, i] /= L[i, i]
    _dent(series, q)
    for g in range(count):
        _lever(series, g, q)
    for i in range(n):
        _combine(series, i, springs)


@kernel(fastmath=REASSOCIATE)
def _warp(series: InSeries, g: int, q: Array) -> None:
    """A and F⁻¹ of one grab: R U^½ of F = R U = I + gradient q, stretched by `LEAST_STRETCH` at least."""
    T = series.gradient
    a, b, c, d, e, h, i, j, k = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for f in range(q.shape[0]):
        v = q[f]
        a += v * T[g, 0, 0, f]
        b += v * T[g, 0, 1, f]
        c += v * T[g, 0, 2, f]
        d += v * T[g, 1, 0, f]
        e += v * T[g, 1, 1, f]
        h += v * T[g, 1, 2, f]
        i += v * T[g, 2, 0, f]
        j += v * T[g, 2, 1, f]
        k += v * T[g, 2, 2, f]
    P, (x, y, z), V = signed_svd((a, b, c, d, e, h, i, j, k))
    x, y, z = max(x, LEAST_STRETCH), max(y, LEAST_STRETCH), max(z, LEAST_STRETCH)
    A = product_transposed(_scaled(P, math.sqrt(x), math.sqrt(y), math.sqrt(z)), V)
    inverse = product_transposed(_scaled(V, 1 / x, 1 / y, 1 / z), P)
    for e in range(9):
        series.warps[g, e // 3, e % 3], series.inverses[g, e // 3, e % 3] = A[e], inverse[e]


@kernel()
def _scaled(M: Matrix, x: float, y: float, z: float) -> Matrix:
    """The columns of M times x, y and z."""
    return M[0] * x, M[1] * y, M[2] * z, M[3] * x, M[4] * y, M[5] * z, M[6] * x, M[7] * y, M[8] * z


@kernel(fastmath=REASSOCIATE)
def _dent(series: InSeries, q: Array) -> None:
    """Of the way p of each centroid to its target, what is not the stretch of its spring: p − f/k, f = L⁻ᵀ L⁻¹ p."""
    n, way, dents, pull = series.softness.shape[0], series.base, series.dents, series.pull
    for i in range(n):
        way[i] = series.target[i] - series.centre[i]
        for f in range(q.shape[0]):
            way[i] -= series.B[i, f] * q[f]
    for i in range(n):
        dents[i] = 0.0
        for j in range(i + 1):
            dents[i] += pull[j, i] * way[j]
    for i in range(n):  # row i of L⁻ᵀ has nothing before i, so what was read may be written
        force = 0.0
        for j in range(i, n):
            force += pull[i, j] * dents[j]
        dents[i] = way[i] - series.softness[i] * force


@kernel(fastmath=REASSOCIATE)
def _lever(series: InSeries, g: int, q: Array) -> None:
    """B + H of one grab, and the centre such that at q nothing is moved."""
    inverse, gradient, levers, k = series.inverses, series.gradient, series.levers, q.shape[0]
    x, y, z = series.dents[3 * g], series.dents[3 * g + 1], series.dents[3 * g + 2]
    for i in range(3):
        row, beside = 3 * g + i, 0.0
        for f in range(k):
            levers[row, f] = series.B[row, f]
        for e in range(9):
            # of ¾ Σ_b T[i, b] (F⁻¹ x)_b − ¼ Σ_ab F⁻¹[b, i] x_a T[a, b], with T = ∂F/∂q
            a, b = e // 3, e % 3
            share = -0.25 * inverse[g, b, i] * series.dents[3 * g + a]
            if a == i:
                share += 0.75 * (inverse[g, b, 0] * x + inverse[g, b, 1] * y + inverse[g, b, 2] * z)
            for f in range(k):
                levers[row, f] += share * gradient[g, a, b, f]
        for f in range(k):
            beside += (levers[row, f] - series.B[row, f]) * q[f]
        series.base[row] = series.centre[row] - beside


@kernel()
def _combine(series: InSeries, i: int, springs: Springs) -> None:
    """Row i of L⁻¹ (levers, base, target)."""
    g, axis, k = i // 3, i % 3, springs.B.shape[2]
    springs.centre[g, axis] = springs.target[g, axis] = 0.0
    for f in range(k):
        springs.B[g, axis, f] = 0.0
    for j in range(i + 1):
        share = series.pull[j, i]
        springs.centre[g, axis] += share * series.base[j]
        springs.target[g, axis] += share * series.target[j]
        for f in range(k):
            springs.B[g, axis, f] += share * series.levers[j, f]


@kernel()
def _warped_pair(series: InSeries, g: int, h: int, out: Array) -> None:
    """The block of grabs g and h of A B C Bᵀ Aᵀ; of C and its transpose, which differ by rounding, the mean."""
    C, A = series.compliance, series.warps
    for i in range(3):
        for j in range(3):
            total = 0.0
            for a in range(3):
                for b in range(3):
                    total += A[g, i, a] * 0.5 * (C[3 * g + a, 3 * h + b] + C[3 * h + b, 3 * g + a]) * A[h, j, b]
            out[3 * g + i, 3 * h + j] = total
