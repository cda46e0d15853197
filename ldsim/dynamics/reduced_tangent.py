"""The tangents of the reduced incremental potential, for preconditioners and Newton's method; compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ldsim.dynamics.reduced_potential import Reduced, Springs, Work, inner, strains
from ldsim.mechanics.materials import deformation, tangent
from ldsim.mechanics.materials.tensors import Matrix, Symmetric
from ldsim.reduction.decoder import REASSOCIATE

Array = NDArray[np.float64]


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


@njit(cache=True, nogil=True, fastmath=REASSOCIATE)
def _directional(G: Array, s: int, J: Array, a: int) -> Matrix:
    """G_s J_a: the strain of point s along direction a."""
    b, c, d, e, f, g, h, i, j = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(G.shape[2]):
        v = J[a, n]
        b += G[s, 0, n] * v
        c += G[s, 1, n] * v
        d += G[s, 2, n] * v
        e += G[s, 3, n] * v
        f += G[s, 4, n] * v
        g += G[s, 5, n] * v
        h += G[s, 6, n] * v
        i += G[s, 7, n] * v
        j += G[s, 8, n] * v
    return b, c, d, e, f, g, h, i, j


@njit(cache=True, nogil=True, fastmath=REASSOCIATE)
def _add_products(X: Array, T: Array, H: Array) -> None:
    """H += Tᵀ X for X, T (9, r)."""
    for a in range(H.shape[0]):
        t0, t1, t2, t3, t4 = T[0, a], T[1, a], T[2, a], T[3, a], T[4, a]
        t5, t6, t7, t8 = T[5, a], T[6, a], T[7, a], T[8, a]
        for b in range(H.shape[0]):
            H[a, b] += (
                ((t0 * X[0, b] + t1 * X[1, b]) + (t2 * X[2, b] + t3 * X[3, b]))
                + ((t4 * X[4, b] + t5 * X[5, b]) + (t6 * X[6, b] + t7 * X[7, b]))
                + t8 * X[8, b]
            )  # fmt: skip


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
    G = model.G
    strains(G, work.q, model.lifted, work.strain)
    for s in range(model.weights.shape[0]):
        F = deformation(work.strain, s)
        U, V, D, O = tangent(model.kind[s], F, model.mu[s], model.lam[s], True)
        for a in range(r):
            if identity:
                x = (
                    G[s, 0, a], G[s, 1, a], G[s, 2, a], G[s, 3, a], G[s, 4, a],
                    G[s, 5, a], G[s, 6, a], G[s, 7, a], G[s, 8, a]
                )  # fmt: skip
            else:
                x = _directional(G, s, J, a)
            _stress_direction(U, V, D, O, model.weights[s], x, X, T, a)
        _add_products(X, T, H)


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
