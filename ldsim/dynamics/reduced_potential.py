"""The incremental potential of a reduced space and its tangents, compiled: serial and without allocation.

One code path for the linear and the latent space: the linear space is the latent one with the identity decoder.

    E(z) = ½ (q − q̂)ᵀ M̃/h² (q − q̂) + Σ_s w_s Ψ(F_s) − f̃·q + Σ ½ k ‖c₀ + B q − target‖²,  q = φ(z)

(paper, Eq. 12). Cubature points see the reduced coordinates directly, F_s = I + G_s q, so neither the mesh nor the kind
of element matters.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ldsim.mechanics.materials import energy_stress, tangent
from ldsim.reduction.decoder import REASSOCIATE, Layers, decode, decode_vjp

Array = NDArray[np.float64]


class Reduced(NamedTuple):
    """A reduced model, as the compiled step reads it.

    layers: the decoder. G (k, 9c): ∂F/∂q of every cubature point, 1/m. weights (c,) m³; kind, mu, lam (c,). inertia
    (k, k): M̃/h². metric (k, k): M̃/h² + K̃₀, or K̃₀ alone for Eq. 15. force (k,): Uᵀ f_ext, N.
    """

    layers: Layers
    G: Array
    weights: Array
    kind: NDArray[np.int8]
    mu: Array
    lam: Array
    inertia: Array
    metric: Array
    force: Array


class Springs(NamedTuple):
    """The grabs of one step: B (g, 3, k) and c₀ (g, 3) with c(q) = c₀ + B q, targets (g, 3) m, stiffness (g,) N/m."""

    B: Array
    centre: Array
    target: Array
    stiffness: Array


class Work(NamedTuple):
    """Scratch memory of one instance; two threads must not share it."""

    hidden: Array
    scratch: Array
    q: Array
    offset: Array
    F: Array
    force: Array
    g: Array
    g_new: Array
    d: Array
    z_new: Array
    jacobian: Array
    product: Array
    hessian: Array
    directions: Array
    stressed: Array
    S: Array
    Y: Array
    rho: Array
    alpha: Array


@njit(cache=True, nogil=True, fastmath=REASSOCIATE)
def inner(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@njit(cache=True, nogil=True)
def _strains(G: Array, q: Array, F: Array) -> None:
    """F = I + G q for all points, (9c,)."""
    _directional_strains(G, q, F)
    F[0::9] += 1.0
    F[4::9] += 1.0
    F[8::9] += 1.0


@njit(cache=True, nogil=True)
def _directional_strains(G: Array, q: Array, F: Array) -> None:
    """F = G q for all points, (9c,); four rows at a time, so that F is loaded less often."""
    F[:] = 0.0
    k = q.shape[0]
    even = k - k % 4
    for j in range(0, even, 4):
        a, b, c, d = q[j], q[j + 1], q[j + 2], q[j + 3]
        row_a, row_b, row_c, row_d = G[j], G[j + 1], G[j + 2], G[j + 3]
        for i in range(F.shape[0]):
            F[i] += a * row_a[i] + b * row_b[i] + c * row_c[i] + d * row_d[i]
    for j in range(even, k):
        a = q[j]
        row_a = G[j]
        for i in range(F.shape[0]):
            F[i] += a * row_a[i]


@njit(cache=True, nogil=True)
def _project(G: Array, P: Array, force: Array) -> None:
    """force += Gᵀ P."""
    for j in range(G.shape[0]):
        force[j] += inner(G[j], P)


@njit(cache=True, nogil=True)
def _stresses(model: Reduced, F: Array) -> float:
    """Energy of all points; overwrites F with w P."""
    total = 0.0
    for s in range(model.weights.shape[0]):
        i = 9 * s
        deformation = (F[i], F[i + 1], F[i + 2], F[i + 3], F[i + 4], F[i + 5], F[i + 6], F[i + 7], F[i + 8])
        density, P = energy_stress(model.kind[s], deformation, model.mu[s], model.lam[s])
        if not density < math.inf:
            return math.inf
        w = model.weights[s]
        total += w * density
        F[i] = w * P[0]
        F[i + 1] = w * P[1]
        F[i + 2] = w * P[2]
        F[i + 3] = w * P[3]
        F[i + 4] = w * P[4]
        F[i + 5] = w * P[5]
        F[i + 6] = w * P[6]
        F[i + 7] = w * P[7]
        F[i + 8] = w * P[8]
    return total


@njit(cache=True, nogil=True)
def _add_springs(springs: Springs, q: Array, force: Array) -> float:
    """Energy of the grabs; adds their gradient to `force`."""
    value = 0.0
    for g in range(springs.stiffness.shape[0]):
        stiffness = springs.stiffness[g]
        for axis in range(3):
            row = springs.B[g, axis]
            pull = springs.centre[g, axis] - springs.target[g, axis] + inner(row, q)
            value += 0.5 * stiffness * pull * pull
            for j in range(q.shape[0]):
                force[j] += stiffness * pull * row[j]
    return value


@njit(cache=True, nogil=True)
def value_gradient(model: Reduced, springs: Springs, predictor: Array, z: Array, work: Work, gradient: Array) -> float:
    """E(z), J, and its gradient, N; q = φ(z) is left in work.q."""
    q, force, offset = work.q, work.force, work.offset
    decode(model.layers, z, work.hidden, q)
    _strains(model.G, q, work.F)
    value = _stresses(model, work.F)
    if not value < math.inf:
        return math.inf
    k = q.shape[0]
    for j in range(k):
        offset[j] = q[j] - predictor[j]
    for j in range(k):
        momentum = inner(model.inertia[j], offset)
        force[j] = momentum - model.force[j]
        value += 0.5 * offset[j] * momentum - model.force[j] * q[j]
    value += _add_springs(springs, q, force)
    _project(model.G, work.F, force)
    decode_vjp(model.layers, work.hidden, force, work.scratch, gradient)
    return value


@njit(cache=True, nogil=True)
def _project_metric(metric: Array, J: Array, product: Array, H: Array) -> None:
    """H = J metric Jᵀ for J (r, k), by way of product = J metric."""
    r, k = J.shape
    for a in range(r):
        row = product[a]
        row[:] = 0.0
        for i in range(k):
            x = J[a, i]
            column = metric[i]
            for j in range(k):
                row[j] += x * column[j]
    for a in range(r):
        for b in range(a + 1):
            H[a, b] = inner(product[a], J[b])
            H[b, a] = H[a, b]


@njit(cache=True, nogil=True)
def rest_metric(model: Reduced, work: Work) -> None:
    """hessian = Jᵀ metric J, the preconditioner of the design (paper, Eq. 15, with inertia)."""
    if model.layers.sizes.shape[0] == 1:
        work.hessian[:] = model.metric
    else:
        _project_metric(model.metric, work.jacobian, work.product, work.hessian)


@njit(cache=True, nogil=True)
def current_tangent(model: Reduced, work: Work) -> None:
    """hessian = Jᵀ (M̃/h² + Σ w Gᵀ ∂²Ψ/∂F² G) J at work.q, eigenvalues clamped at every point.

    The strains of all latent directions, X_a = Uᵀ (G_s J_a) V, are turned into the frame of the singular vectors, where
    the tangent is sparse.
    """
    J, H, X, T = work.jacobian, work.hessian, work.directions, work.stressed
    r = J.shape[0]
    if model.layers.sizes.shape[0] == 1:
        H[:] = model.inertia
        X[:] = model.G
    else:
        _project_metric(model.inertia, J, work.product, H)
        for a in range(r):
            _directional_strains(model.G, J[a], X[a])
    _strains(model.G, work.q, work.F)
    for s in range(model.weights.shape[0]):
        _stress_directions(model, work.F, s, X, T)
    for a in range(r):
        for b in range(a + 1):
            H[a, b] += inner(T[a], X[b])
            H[b, a] = H[a, b]


@njit(cache=True, nogil=True)
def _stress_directions(model: Reduced, F: Array, s: int, X: Array, T: Array) -> None:
    """Overwrites point s of every X_a by its strain in the singular frame, T_a by w times the tangent applied to it."""
    i = 9 * s
    deformation = (F[i], F[i + 1], F[i + 2], F[i + 3], F[i + 4], F[i + 5], F[i + 6], F[i + 7], F[i + 8])
    U, V, D, O = tangent(model.kind[s], deformation, model.mu[s], model.lam[s], True)
    w = model.weights[s]
    for a in range(X.shape[0]):
        x, t = X[a], T[a]
        for p in range(3):
            m0 = U[p] * x[i] + U[3 + p] * x[i + 3] + U[6 + p] * x[i + 6]
            m1 = U[p] * x[i + 1] + U[3 + p] * x[i + 4] + U[6 + p] * x[i + 7]
            m2 = U[p] * x[i + 2] + U[3 + p] * x[i + 5] + U[6 + p] * x[i + 8]
            t[i + 3 * p] = m0 * V[0] + m1 * V[3] + m2 * V[6]
            t[i + 3 * p + 1] = m0 * V[1] + m1 * V[4] + m2 * V[7]
            t[i + 3 * p + 2] = m0 * V[2] + m1 * V[5] + m2 * V[8]
        for e in range(9):
            x[i + e] = t[i + e]
        t[i] = w * (D[0] * x[i] + D[3] * x[i + 4] + D[4] * x[i + 8])
        t[i + 4] = w * (D[3] * x[i] + D[1] * x[i + 4] + D[5] * x[i + 8])
        t[i + 8] = w * (D[4] * x[i] + D[5] * x[i + 4] + D[2] * x[i + 8])
        t[i + 1] = w * (O[0] * x[i + 1] + O[3] * x[i + 3])
        t[i + 3] = w * (O[0] * x[i + 3] + O[3] * x[i + 1])
        t[i + 2] = w * (O[1] * x[i + 2] + O[4] * x[i + 6])
        t[i + 6] = w * (O[1] * x[i + 6] + O[4] * x[i + 2])
        t[i + 5] = w * (O[2] * x[i + 5] + O[5] * x[i + 7])
        t[i + 7] = w * (O[2] * x[i + 7] + O[5] * x[i + 5])


@njit(cache=True, nogil=True)
def add_spring_metric(springs: Springs, model: Reduced, work: Work) -> None:
    """hessian += k (B J)ᵀ (B J) of every grab."""
    J, H = work.jacobian, work.hessian
    r, k = J.shape
    row = work.d
    identity = model.layers.sizes.shape[0] == 1
    for g in range(springs.stiffness.shape[0]):
        for axis in range(3):
            for a in range(r):
                total = 0.0
                if identity:
                    total = springs.B[g, axis, a]
                else:
                    for j in range(k):
                        total += springs.B[g, axis, j] * J[a, j]
                row[a] = total
            for a in range(r):
                for b in range(r):
                    H[a, b] += springs.stiffness[g] * row[a] * row[b]
