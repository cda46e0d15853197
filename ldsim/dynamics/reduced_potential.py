"""The incremental potential of a reduced space and its tangents, compiled: serial and without allocation.

One code path for the linear and the latent space: the linear space is the latent one with the identity decoder.

    E(z) = ½ (q − q̂)ᵀ M̃/h² (q − q̂) + Σ_s w_s Ψ(F_s) − f̃·q + Σ ½ k ‖c₀ + B q − target‖²,  q = φ(z)

(paper, Eq. 12). Cubature points see the reduced coordinates directly, F_s = I + G_s q, so neither the mesh nor the kind
of element matters. Pins that move add their own strain there (reduction/lifting.py).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ldsim.mechanics.materials import energy_stress, tangent
from ldsim.mechanics.materials.tensors import Matrix, Symmetric
from ldsim.reduction.decoder import REASSOCIATE, Layers, decode, decode_vjp

Array = NDArray[np.float64]


class Reduced(NamedTuple):
    """A reduced model, as the compiled step reads it.

    layers: the decoder. G (c, 9, k): ∂F/∂q of every cubature point, 1/m. weights (c,) m³; kind, mu, lam (c,). inertia
    (k, k): M̃/h², or its diagonal (1, k) where that is all. metric (k, k): M̃/h² + K̃₀, or K̃₀ alone for Eq. 15. force
    (k,): Uᵀ f_ext, N. lifted (c, 9): what pins that move add to F of every point, or (0, 9) where none can.
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
    lifted: Array


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
    Hy: Array


@njit(cache=True, nogil=True, fastmath=REASSOCIATE)
def inner(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@njit(cache=True, nogil=True, fastmath=REASSOCIATE)
def _contract(rows: Array, x: Array) -> Matrix:
    """The nine products of the rows (9, k) with x (k,), in one pass."""
    a, b, c, d, e, f, g, h, i = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    A, B, C, D, E, F, G, H, I = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7], rows[8]
    for j in range(x.shape[0]):
        v = x[j]
        a += A[j] * v
        b += B[j] * v
        c += C[j] * v
        d += D[j] * v
        e += E[j] * v
        f += F[j] * v
        g += G[j] * v
        h += H[j] * v
        i += I[j] * v
    return a, b, c, d, e, f, g, h, i


@njit(cache=True, nogil=True, fastmath=REASSOCIATE)
def _combine(rows: Array, p: Matrix, out: Array) -> None:
    """out += Σ p_e rows_e over the nine rows, in one pass."""
    a, b, c, d, e, f, g, h, i = p
    A, B, C, D, E, F, G, H, I = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7], rows[8]
    for j in range(out.shape[0]):
        out[j] += a * A[j] + b * B[j] + c * C[j] + d * D[j] + e * E[j] + f * F[j] + g * G[j] + h * H[j] + i * I[j]


@njit(cache=True, nogil=True)
def _deformation(G: Array, q: Array, lifted: Array, s: int) -> Matrix:
    """F = I + G_s q of point s, with what moving pins add."""
    a, b, c, d, e, f, g, h, i = _contract(G, q)
    if lifted.shape[0] > 0:
        L = lifted[s]
        return (
            1.0 + a + L[0],
            b + L[1],
            c + L[2],
            d + L[3],
            1.0 + e + L[4],
            f + L[5],
            g + L[6],
            h + L[7],
            1.0 + i + L[8],
        )
    return 1.0 + a, b, c, d, 1.0 + e, f, g, h, 1.0 + i


@njit(cache=True, nogil=True)
def _add_elastic(model: Reduced, q: Array, force: Array) -> float:
    """Energy of all points; adds Σ w_s G_sᵀ P_s to `force`. One point at a time, so that its G is read once."""
    total = 0.0
    for s in range(model.weights.shape[0]):
        G, w = model.G[s], model.weights[s]
        F = _deformation(G, q, model.lifted, s)
        density, P = energy_stress(model.kind[s], F, model.mu[s], model.lam[s])
        if not density < math.inf:
            return math.inf
        total += w * density
        a, b, c, d, e, f, g, h, i = P
        _combine(G, (w * a, w * b, w * c, w * d, w * e, w * f, w * g, w * h, w * i), force)
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
    value = 0.0
    k = q.shape[0]
    for j in range(k):
        offset[j] = q[j] - predictor[j]
    for j in range(k):
        momentum = model.inertia[0, j] * offset[j] if model.inertia.shape[0] == 1 else inner(model.inertia[j], offset)
        force[j] = momentum - model.force[j]
        value += 0.5 * offset[j] * momentum - model.force[j] * q[j]
    value += _add_springs(springs, q, force)
    value += _add_elastic(model, q, force)
    if value < math.inf:
        decode_vjp(model.layers, work.hidden, force, work.scratch, gradient)
    return value


@njit(cache=True, nogil=True)
def _project_metric(metric: Array, J: Array, product: Array, H: Array) -> None:
    """H = J metric Jᵀ for J (r, k), by way of product = J metric; a metric of one row is diagonal."""
    r, k = J.shape
    for a in range(r):
        row = product[a]
        if metric.shape[0] == 1:
            row[:] = metric[0] * J[a]
            continue
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
    identity = model.layers.sizes.shape[0] == 1
    if not identity:
        _project_metric(model.inertia, J, work.product, H)
    elif model.inertia.shape[0] > 1:
        H[:] = model.inertia
    else:
        H[:] = 0.0
        for a in range(r):
            H[a, a] = model.inertia[0, a]
    for s in range(model.weights.shape[0]):
        G = model.G[s]
        F = _deformation(G, work.q, model.lifted, s)
        U, V, D, O = tangent(model.kind[s], F, model.mu[s], model.lam[s], True)
        for a in range(r):
            if identity:
                x = (G[0, a], G[1, a], G[2, a], G[3, a], G[4, a], G[5, a], G[6, a], G[7, a], G[8, a])
            else:
                x = _contract(G, J[a])
            _stress_direction(U, V, D, O, model.weights[s], x, X, T, a)
        for a in range(r):
            t = (T[0, a], T[1, a], T[2, a], T[3, a], T[4, a], T[5, a], T[6, a], T[7, a], T[8, a])
            _combine(X, t, H[a])


@njit(cache=True, nogil=True)
def _stress_direction(
    U: Matrix, V: Matrix, D: Symmetric, O: Symmetric, w: float, x: Matrix, X: Array, T: Array, a: int
) -> None:
    """Columns a of X and T (9, r): the strain Uᵀ x V in the singular frame, and w times the tangent applied to it."""
    for p in range(3):
        m0 = U[p] * x[0] + U[3 + p] * x[3] + U[6 + p] * x[6]
        m1 = U[p] * x[1] + U[3 + p] * x[4] + U[6 + p] * x[7]
        m2 = U[p] * x[2] + U[3 + p] * x[5] + U[6 + p] * x[8]
        X[3 * p, a] = m0 * V[0] + m1 * V[3] + m2 * V[6]
        X[3 * p + 1, a] = m0 * V[1] + m1 * V[4] + m2 * V[7]
        X[3 * p + 2, a] = m0 * V[2] + m1 * V[5] + m2 * V[8]
    T[0, a] = w * (D[0] * X[0, a] + D[3] * X[4, a] + D[4] * X[8, a])
    T[4, a] = w * (D[3] * X[0, a] + D[1] * X[4, a] + D[5] * X[8, a])
    T[8, a] = w * (D[4] * X[0, a] + D[5] * X[4, a] + D[2] * X[8, a])
    T[1, a] = w * (O[0] * X[1, a] + O[3] * X[3, a])
    T[3, a] = w * (O[0] * X[3, a] + O[3] * X[1, a])
    T[2, a] = w * (O[1] * X[2, a] + O[4] * X[6, a])
    T[6, a] = w * (O[1] * X[6, a] + O[4] * X[2, a])
    T[5, a] = w * (O[2] * X[5, a] + O[5] * X[7, a])
    T[7, a] = w * (O[2] * X[7, a] + O[5] * X[5, a])


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
