"""The springs of grabs in a condensed space: in series with its residual compliance, which warps with the solid.

A spring that pulls at the centroid of some vertices acts in series with C (space/compliance.py), which is known at
rest. Where the solid is held it may have turned by then: what was soft across a rod is soft across it still. So a force
is turned back, C at rest is applied, and what that moves is turned again, C ≈ A C₀ Aᵀ with one A = R a grab, as warping
does to stiffness (Müller et al. 2002, "Stable real-time deformations"); and what is stretched gives way further, so A =
R U^½ of the deformation gradient F = R U around it (`space.compliance.warp`). It is that of the state in which a step
begins.

To the next order C changes with the coordinates z, the first of q, and with the force, d = (C + N z) f + ½ D(f, f)
(space/compliance.py, `Dent`). A step sees the tangent at the force f₀ with which it begins: C + N z + D f₀ for C, and ½ A D(f₀, f₀) less of the way.

The spring holds the solid by the end of the dent x = A d that it makes, and A d moves with q as well: that is a lever
on which the force turns and stretches the solid, H = ∂(A d)/∂q at fixed d. With L_j = ∂F/∂q_j F⁻¹, to first order in
the stretch, ∂A/∂q_j = (skew L_j + ½ sym L_j) A, so H_j = (¾ L_j − ¼ L_jᵀ) x, and of N, whose energy is ½ fᵀ N z f, ½ A
N_j Aᵀ f beside it.
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
from ldsim.space.compliance import LEAST_STRETCH, MOST_CHANGED
from ldsim.space.decoder import REASSOCIATE
from ldsim.space.space import Space

# Newton steps for the forces of bent laws.
BENT_STEPS = 3


class InSeries(NamedTuple):
    """What some grabs have as long as they hold the same vertices.

    B (3g, k) and centre (3g,): c(q) = centre + B q, metres, of all centroids. compliance (3g, 3g): B C Bᵀ at rest, m/N.
    softness (3g,): 1/k. gradient (g, 3, 3, k): F = I + gradient q of the cells around (`Compliance.arms`). target
    (3g,): metres, to be written. coupling (g, r, 3, 3), second (g, 3, 3, 3) and root (g, 3, 3): of `Dent`; linear:
    whether the first two are zero. Written by `warp_springs`: A and F⁻¹ of each grab, warps and inverses (g, 3, 3);
    shares (g,), how much of N is taken; changes (g, 3, 3), N z + D f₀, and bent
    (g, 3, 3), the latter, m/N; bodies (g, 3), f₀ = Aᵀ f, N, and aside
    (3g,), what the tangent there leaves out, metres; dents (3g,), metres; levers (3g, k), B + H; base (3g,), what the
    centre is then, metres; forces (3g,), N; the pull (3g, 3g) = L⁻ᵀ, which makes forces of the stretch of the unit
    springs, and factor (3g, 3g), of L.
    """

    B: Array
    centre: Array
    compliance: Array
    softness: Array
    gradient: Array
    coupling: Array
    second: Array
    root: Array
    linear: bool
    target: Array
    warps: Array
    inverses: Array
    shares: Array
    changes: Array
    bent: Array
    bodies: Array
    aside: Array
    dents: Array
    forces: Array
    levers: Array
    base: Array
    pull: Array
    factor: Array

    @classmethod
    def none(cls, k: int) -> InSeries:
        """Where there is no grab, or no compliance."""
        shapes = (0, k), (0,), (0, 0), (0,), (0, 3, 3, k), (0, 0, 3, 3), (0, 3, 3, 3), (0, 3, 3)
        return cls(*map(np.zeros, shapes), True, *_written(0, k))

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
        laws = [compliance.dent(vertices) for vertices in held]
        coupling, second, root = (np.stack([law[i] for law in laws]) for i in (1, 2, 3))
        return cls(
            np.concatenate([U[vertices].mean(axis=0) for vertices in held]),
            np.concatenate([sunk[vertices].mean(axis=0) for vertices in held]),
            compliance.between(held),
            np.repeat([1 / grab.stiffness for grab in grabs], 3),
            np.stack(gradient),
            coupling,
            second,
            root,
            not (coupling.any() or second.any()),
            *_written(len(held), U.shape[2]),
        )


def _written(count: int, k: int) -> list[Array]:
    """Room for the target and for all that `warp_springs` writes, of some grabs."""
    n = 3 * count
    small, each = (count, 3, 3), (n,)
    shapes = each, small, small, (count,), small, small, (count, 3), each, each, each, (n, k), each, (n, n), (n, n)
    return [np.zeros(shape) for shape in shapes]


@kernel()
def warp_springs(series: InSeries, q: Array, springs: Springs) -> None:
    """Write the springs, and all else that the series says, for a state with coordinates q, (k,).

    Their energy ½ pᵀ (diag(1/k) + A B C Bᵀ Aᵀ)⁻¹ p couples all grabs. With the Cholesky factor L of what is inverted it
    is ½ ‖L⁻¹ p‖²: springs of unit stiffness on L⁻¹ B, which the kernel of a step knows.
    """
    for g in range(series.warps.shape[0]):
        _warp(series, g, q)
        _couple(series, g, q)
    series.aside[:] = 0.0
    _aim(series, q)
    # Newton's method for the forces, from the linear law; three steps end at rounding where dents are a fifth off it
    for _ in range(0 if series.linear else BENT_STEPS):
        for g in range(series.warps.shape[0]):
            _bend(series, g, q)
        _aim(series, q)
    for g in range(series.warps.shape[0]):
        _lever(series, g, q)
    for i in range(series.softness.shape[0]):
        _combine(series, i, springs)


@kernel()
def _aim(series: InSeries, q: Array) -> None:
    """The factor and its inverse, and forces and dents by them."""
    n, L, pull = series.softness.shape[0], series.factor, series.pull
    for g in range(series.warps.shape[0]):
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


@kernel()
def _couple(series: InSeries, g: int, q: Array) -> None:
    """How one grab's C changes with the coordinates: N z, as much of it as is taken."""
    N, change = series.coupling, series.changes
    for i in range(3):
        for j in range(3):
            change[g, i, j] = 0.0
            for f in range(N.shape[1]):
                change[g, i, j] += q[f] * N[g, f, i, j]
    series.shares[g] = _limit(series.root, change, g)
    for i in range(3):
        for j in range(3):
            change[g, i, j] *= series.shares[g]


@kernel()
def _bend(series: InSeries, g: int, q: Array) -> None:
    """The tangent of one grab's law at the force that it has: D f₀ beside N z, and ½ A D(f₀, f₀)."""
    A, D, f, change = series.warps, series.second, series.bodies, series.changes
    _couple(series, g, q)
    for a in range(3):
        f[g, a] = 0.0
        for i in range(3):
            f[g, a] += A[g, i, a] * series.forces[3 * g + i]
    bent = series.bent
    for i in range(3):
        for j in range(3):
            bent[g, i, j] = D[g, i, j, 0] * f[g, 0] + D[g, i, j, 1] * f[g, 1] + D[g, i, j, 2] * f[g, 2]
    taken = _limit(series.root, bent, g)
    for i in range(3):
        series.aside[3 * g + i] = 0.0
    for a in range(3):
        beside = 0.0
        for b in range(3):
            change[g, a, b] += taken * bent[g, a, b]
            beside += 0.5 * taken**2 * bent[g, a, b] * f[g, b]
        for i in range(3):
            series.aside[3 * g + i] += A[g, i, a] * beside


@kernel()
def _limit(root: Array, change: Array, g: int) -> float:
    """How much of a change of one grab's C is taken, at most 1."""
    size = 0.0
    for i in range(3):
        for j in range(3):
            entry = 0.0
            for a in range(3):
                for b in range(3):
                    entry += root[g, i, a] * change[g, a, b] * root[g, b, j]
            size += entry**2
    return 1.0 if size <= MOST_CHANGED**2 else MOST_CHANGED / math.sqrt(size)


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
    """Forces f = L⁻ᵀ L⁻¹ (p + aside) of the ways p of the centroids to their targets, and the dents p − f/k."""
    n, way, dents, pull = series.softness.shape[0], series.base, series.dents, series.pull
    for i in range(n):
        way[i] = series.target[i] - series.centre[i]
        for f in range(q.shape[0]):
            way[i] -= series.B[i, f] * q[f]
    for i in range(n):
        dents[i] = 0.0
        for j in range(i + 1):
            dents[i] += pull[j, i] * (way[j] + series.aside[j])
    for i in range(n):  # row i of L⁻ᵀ has nothing before i, so what was read may be written
        series.forces[i] = 0.0
        for j in range(i, n):
            series.forces[i] += pull[i, j] * dents[j]
        dents[i] = way[i] - series.softness[i] * series.forces[i]


@kernel(fastmath=REASSOCIATE)
def _lever(series: InSeries, g: int, q: Array) -> None:
    """B + H of one grab, and the centre such that at q nothing is moved but by what the tangent leaves out."""
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
        for f in range(series.coupling.shape[1]):
            levers[row, f] += 0.5 * series.shares[g] * _changed(series, g, i, f)
        for f in range(k):
            beside += (levers[row, f] - series.B[row, f]) * q[f]
        series.base[row] = series.centre[row] - beside - series.aside[row]


@kernel()
def _changed(series: InSeries, g: int, i: int, f: int) -> float:
    """Entry i of A N_f f₀ of one grab."""
    total = 0.0
    for a in range(3):
        for b in range(3):
            total += series.warps[g, i, a] * series.coupling[g, f, a, b] * series.bodies[g, b]
    return total


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
    """The block of grabs g and h of A (B C Bᵀ + N z + D f₀) Aᵀ; of C and Cᵀ, which differ by rounding, the mean."""
    C, A = series.compliance, series.warps
    for i in range(3):
        for j in range(3):
            total = 0.0
            for a in range(3):
                for b in range(3):
                    between = 0.5 * (C[3 * g + a, 3 * h + b] + C[3 * h + b, 3 * g + a])
                    if g == h:
                        between += series.changes[g, a, b]
                    total += A[g, i, a] * between * A[h, j, b]
            out[3 * g + i, 3 * h + j] = total
