"""The incremental potential of a reduced space, compiled: serial and without allocation.

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

from ldsim.mechanics.materials import energy_stress
from ldsim.mechanics.materials.tensors import Matrix
from ldsim.reduction.decoder import REASSOCIATE, Decoder, Layers, decode, decode_vjp

Array = NDArray[np.float64]

# Pairs that L-BFGS remembers (paper, Sec. 5.2).
WINDOW = 8


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


def make_work(decoder: Decoder) -> Work:
    """Scratch memory for one instance of a decoder."""
    r, k, hidden = decoder.r, decoder.k, decoder.hidden_size
    return Work(
        hidden=np.zeros(hidden),
        scratch=np.zeros(hidden),
        q=np.zeros(k),
        offset=np.zeros(k),
        force=np.zeros(k),
        g=np.zeros(r),
        g_new=np.zeros(r),
        d=np.zeros(r),
        z_new=np.zeros(r),
        jacobian=np.zeros((r, k)),
        product=np.zeros((r, k)),
        hessian=np.zeros((r, r)),
        directions=np.zeros((9, r)),
        stressed=np.zeros((9, r)),
        S=np.zeros((WINDOW, r)),
        Y=np.zeros((WINDOW, r)),
        rho=np.zeros(WINDOW),
        alpha=np.zeros(WINDOW),
        Hy=np.zeros(r),
    )


@njit(cache=True, nogil=True, fastmath=REASSOCIATE)
def inner(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@njit(cache=True, nogil=True, fastmath=REASSOCIATE)
def contract(rows: Array, x: Array) -> Matrix:
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
def combine(rows: Array, p: Matrix, out: Array) -> None:
    """out += Σ p_e rows_e over the nine rows, in one pass."""
    a, b, c, d, e, f, g, h, i = p
    A, B, C, D, E, F, G, H, I = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7], rows[8]
    for j in range(out.shape[0]):
        out[j] += a * A[j] + b * B[j] + c * C[j] + d * D[j] + e * E[j] + f * F[j] + g * G[j] + h * H[j] + i * I[j]


@njit(cache=True, nogil=True)
def deformation(G: Array, q: Array, lifted: Array, s: int) -> Matrix:
    """F = I + G_s q of point s, with what moving pins add."""
    a, b, c, d, e, f, g, h, i = contract(G, q)
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
        F = deformation(G, q, model.lifted, s)
        density, P = energy_stress(model.kind[s], F, model.mu[s], model.lam[s])
        if not density < math.inf:
            return math.inf
        total += w * density
        a, b, c, d, e, f, g, h, i = P
        combine(G, (w * a, w * b, w * c, w * d, w * e, w * f, w * g, w * h, w * i), force)
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
