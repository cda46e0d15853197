"""The tangents of the reduced incremental potential, for preconditioners and Newton's method; compiled."""

from __future__ import annotations

from ldsim.arrays import Array
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work, inner, strains
from ldsim.jit import copy, kernel
from ldsim.mechanics.materials.kernels import deformation, tangent
from ldsim.mechanics.materials.tensors import Matrix, Symmetric
from ldsim.space.decoder import REASSOCIATE


@kernel()
def _project_metric(metric: Array, J: Array, product: Array, H: Array) -> None:
    """H = J metric Jᵀ for J (r, k), by way of product = J metric; a metric of one row is diagonal."""
    r, k = J.shape
    for a in range(r):
        row = product[a]
        if metric.shape[0] == 1:
            for i in range(k):
                row[i] = metric[0, i] * J[a, i]
            continue
        row[:] = 0.0
        # i outside: the inner loop then runs along a row of the metric, not down a column
        for i in range(k):
            x = J[a, i]
            column = metric[i]
            for j in range(k):
                row[j] += x * column[j]
    # half of it, for it is symmetric, and exactly so, as a Cholesky factor likes it
    for a in range(r):
        for b in range(a + 1):
            H[a, b] = inner(product[a], J[b])
            H[b, a] = H[a, b]


@kernel()
def _copy_rows(source: Array, target: Array) -> None:
    """target ← source, two-dimensional arrays of one shape."""
    for i in range(target.shape[0]):
        copy(source[i], target[i])


@kernel()
def rest_metric(model: Reduced, work: Work) -> None:
    """hessian = Jᵀ metric J, the preconditioner of the design (paper, Eq. 15, with inertia)."""
    if model.layers.sizes.shape[0] == 1:
        _copy_rows(model.metric, work.hessian)
    else:
        _project_metric(model.metric, work.jacobian, work.product, work.hessian)


@kernel(fastmath=REASSOCIATE)
def _put_strains(G: Array, s: int, J: Array, raw: Array) -> None:
    """raw (9, r) = G_s Jᵀ: the strain of point s along every direction; two at a time, to load G less often."""
    last = J.shape[0] - 1
    for pair in range((J.shape[0] + 1) // 2):
        a = 2 * pair
        b = min(a + 1, last)  # an odd one out is computed twice, which is simpler than a loop of its own
        a0, a1, a2, a3, a4, a5, a6, a7, a8 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        b0, b1, b2, b3, b4, b5, b6, b7, b8 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for n in range(G.shape[2]):
            v, w = J[a, n], J[b, n]
            a0 += G[s, 0, n] * v
            b0 += G[s, 0, n] * w
            a1 += G[s, 1, n] * v
            b1 += G[s, 1, n] * w
            a2 += G[s, 2, n] * v
            b2 += G[s, 2, n] * w
            a3 += G[s, 3, n] * v
            b3 += G[s, 3, n] * w
            a4 += G[s, 4, n] * v
            b4 += G[s, 4, n] * w
            a5 += G[s, 5, n] * v
            b5 += G[s, 5, n] * w
            a6 += G[s, 6, n] * v
            b6 += G[s, 6, n] * w
            a7 += G[s, 7, n] * v
            b7 += G[s, 7, n] * w
            a8 += G[s, 8, n] * v
            b8 += G[s, 8, n] * w
        raw[0, a], raw[1, a], raw[2, a], raw[3, a], raw[4, a] = a0, a1, a2, a3, a4
        raw[5, a], raw[6, a], raw[7, a], raw[8, a] = a5, a6, a7, a8
        raw[0, b], raw[1, b], raw[2, b], raw[3, b], raw[4, b] = b0, b1, b2, b3, b4
        raw[5, b], raw[6, b], raw[7, b], raw[8, b] = b5, b6, b7, b8


@kernel(fastmath=REASSOCIATE)
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


@kernel()
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
        _copy_rows(model.inertia, H)
    else:
        H[:] = 0.0
        for a in range(r):
            H[a, a] = model.inertia[0, a]
    G = model.G
    strains(G, work.q, model.lifted, work.strain)
    for s in range(model.weights.shape[0]):
        F = deformation(work.strain, s)
        # clamped: a preconditioner must be positive, and the sum of positive points is
        U, V, D, O = tangent(model.kind[s], F, model.mu[s], model.lam[s], True)
        if identity:  # J = I, so G_s Jᵀ is G_s itself
            _copy_rows(G[s], T)
        else:
            _put_strains(G, s, J, T)
        _turn(U, V, T, X)
        _put_stresses(D, O, model.weights[s], X, T)
        _add_products(X, T, H)


@kernel(fastmath=REASSOCIATE)
def _turn(U: Matrix, V: Matrix, raw: Array, X: Array) -> None:
    """X = Uᵀ raw V, column by column of raw and X (9, r), each a matrix row by row."""
    for p in range(3):
        u0, u1, u2 = U[p], U[3 + p], U[6 + p]
        for a in range(X.shape[1]):
            m0 = u0 * raw[0, a] + u1 * raw[3, a] + u2 * raw[6, a]
            m1 = u0 * raw[1, a] + u1 * raw[4, a] + u2 * raw[7, a]
            m2 = u0 * raw[2, a] + u1 * raw[5, a] + u2 * raw[8, a]
            X[3 * p, a] = m0 * V[0] + m1 * V[3] + m2 * V[6]
            X[3 * p + 1, a] = m0 * V[1] + m1 * V[4] + m2 * V[7]
            X[3 * p + 2, a] = m0 * V[2] + m1 * V[5] + m2 * V[8]


@kernel(fastmath=REASSOCIATE)
def _put_stresses(D: Symmetric, O: Symmetric, w: float, X: Array, T: Array) -> None:
    """T = w times the tangent applied to every column of X (9, r), both in the frame of the singular vectors."""
    for a in range(X.shape[1]):
        T[0, a] = w * (D[0] * X[0, a] + D[3] * X[4, a] + D[4] * X[8, a])
        T[4, a] = w * (D[3] * X[0, a] + D[1] * X[4, a] + D[5] * X[8, a])
        T[8, a] = w * (D[4] * X[0, a] + D[5] * X[4, a] + D[2] * X[8, a])
        T[1, a] = w * (O[0] * X[1, a] + O[3] * X[3, a])
        T[3, a] = w * (O[0] * X[3, a] + O[3] * X[1, a])
        T[2, a] = w * (O[1] * X[2, a] + O[4] * X[6, a])
        T[6, a] = w * (O[1] * X[6, a] + O[4] * X[2, a])
        T[5, a] = w * (O[2] * X[5, a] + O[5] * X[7, a])
        T[7, a] = w * (O[2] * X[7, a] + O[5] * X[5, a])


@kernel()
def add_spring_metric(springs: Springs, model: Reduced, work: Work) -> None:
    """hessian += k (B J)ᵀ (B J) of every grab."""
    J, H = work.jacobian, work.hessian
    r, k = J.shape
    row = work.d  # free until the direction is made
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
