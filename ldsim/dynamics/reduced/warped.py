"""The springs of grabs in a condensed space: in series with its residual compliance, which warps with the solid.

A spring that pulls at the centroid of some vertices acts in series with C (space/compliance.py), which is known at
rest. Where the solid is held it may have turned by then: what was soft across a rod is soft across it still. So a force
is turned back, C at rest is applied, and what that moves is turned again, C ≈ A C₀ Aᵀ with one A = R a grab, as warping
does to stiffness (Müller et al. 2002, "Stable real-time deformations"); and what is stretched gives way further, so A =
R U^½ of the deformation gradient R U around it (`space.compliance.warp`). It is that of the state in which a step
begins.
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
from ldsim.mechanics.materials.tensors import product_transposed, signed_svd
from ldsim.space.compliance import LEAST_STRETCH
from ldsim.space.decoder import REASSOCIATE
from ldsim.space.space import Space


class InSeries(NamedTuple):
    """What some grabs have as long as they hold the same vertices.

    B (3g, k) and centre (3g,): c(q) = centre + B q, metres, of all centroids. compliance (3g, 3g): B C Bᵀ at rest, m/N.
    softness (3g,): 1/k. gradient (g, 3, 3, k): F = I + gradient q of the cells around (`Compliance.arms`). target (3g,):
    metres, to be written. Written by `warp_springs`: A of each grab, warps (g, 3, 3), the pull (3g, 3g) = L⁻ᵀ, which
    makes forces, N, of the stretch of the unit springs, and factor (3g, 3g), of L.
    """

    B: Array
    centre: Array
    compliance: Array
    softness: Array
    gradient: Array
    target: Array
    warps: Array
    pull: Array
    factor: Array

    @classmethod
    def none(cls, k: int) -> InSeries:
        """Where there is no grab, or no compliance."""
        shapes = (0, k), (0,), (0, 0), (0,), (0, 3, 3, k), (0,), (0, 3, 3), (0, 0), (0, 0)
        return cls(*map(np.zeros, shapes))

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
            np.zeros(3 * len(held)),
            np.zeros((len(held), 3, 3)),
            np.zeros((3 * len(held), 3 * len(held))),
            np.zeros((3 * len(held), 3 * len(held))),
        )


@kernel()
def warp_springs(series: InSeries, q: Array, springs: Springs) -> None:
    """Write the springs, and A and the pull of the series, for a state with coordinates q, (k,).

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
    for i in range(n):
        _combine(series, i, springs)


@kernel(fastmath=REASSOCIATE)
def _warp(series: InSeries, g: int, q: Array) -> None:
    """A of one grab, R U^½ of F = R U = I + gradient q."""
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
    P, stretches, V = signed_svd((a, b, c, d, e, h, i, j, k))
    x, y, z = stretches
    x, y, z = math.sqrt(max(x, LEAST_STRETCH)), math.sqrt(max(y, LEAST_STRETCH)), math.sqrt(max(z, LEAST_STRETCH))
    A = product_transposed((P[0] * x, P[1] * y, P[2] * z, P[3] * x, P[4] * y, P[5] * z, P[6] * x, P[7] * y, P[8] * z), V)
    for axis in range(3):
        series.warps[g, axis, 0] = A[3 * axis]
        series.warps[g, axis, 1] = A[3 * axis + 1]
        series.warps[g, axis, 2] = A[3 * axis + 2]


@kernel()
def _combine(series: InSeries, i: int, springs: Springs) -> None:
    """Row i of L⁻¹ (B, centre, target)."""
    g, axis, k = i // 3, i % 3, springs.B.shape[2]
    springs.centre[g, axis] = springs.target[g, axis] = 0.0
    for f in range(k):
        springs.B[g, axis, f] = 0.0
    for j in range(i + 1):
        share = series.pull[j, i]
        springs.centre[g, axis] += share * series.centre[j]
        springs.target[g, axis] += share * series.target[j]
        for f in range(k):
            springs.B[g, axis, f] += share * series.B[j, f]


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
