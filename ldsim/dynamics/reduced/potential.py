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
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.jit import kernel
from ldsim.mechanics.materials.kernels import weighted_stresses
from ldsim.space.decoder import REASSOCIATE, Decoder, Layers, decode, decode_vjp

# Pairs that L-BFGS remembers (paper, Sec. 5.2).
WINDOW = 8


class Reduced(NamedTuple):
    """A reduced model, as the compiled step reads it.

    layers: the decoder. G (c, 9, k): ∂F/∂q of every cubature point, 1/m. weights (c,) m³; kind, mu, lam (c,). inertia
    (k, k): M̃/h², or its diagonal (1, k) where that is all. metric (k, k): M̃/h² + K̃₀, or K̃₀ alone for Eq. 15. force
    (k,): Uᵀ f_ext, N. lifted (c, 9): what pins that move add to F of every point, or (0, 9) where none can. squares
    (m,): ω² of modes that swing, the last of q (space/modes.py), 1/s²; follows, gives (m,): their a, and g in s².
    Inertia and force of these are a times what they are else.
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
    squares: Array
    follows: Array
    gives: Array


def rounding(model: Reduced) -> float:
    """The norm that rounding leaves of a gradient, N, as in `full.potential`; what each point leaves is independent.

    Minimisers ended at a tenth of this to all of it, in beams of steel from a millimetre to a metre long.
    """
    maps = np.linalg.norm(model.G.reshape(len(model.G), -1), axis=1)
    return float(np.finfo(np.float64).eps * np.linalg.norm(model.weights * (model.lam + 2 * model.mu) * maps))


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
    tangents: Array
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
    strain: Array
    S: Array
    Y: Array
    rho: Array
    alpha: Array
    Hy: Array


def make_work(decoder: Decoder, points: int) -> Work:
    """Scratch memory for one instance of a decoder and a number of cubature points."""
    r, k, hidden = decoder.r, decoder.k, decoder.hidden_size
    return Work(
        hidden=np.zeros(hidden),
        scratch=np.zeros(hidden),
        tangents=np.zeros(r * hidden),
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
        strain=np.zeros((9, points)),
        S=np.zeros((WINDOW, r)),
        Y=np.zeros((WINDOW, r)),
        rho=np.zeros(WINDOW),
        alpha=np.zeros(WINDOW),
        Hy=np.zeros(r),
    )


@kernel(fastmath=REASSOCIATE)
def inner(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@kernel(fastmath=REASSOCIATE)
def strains(G: Array, q: Array, lifted: Array, strain: Array) -> None:
    """strain (9, c) = G_s q of every point, with what moving pins add."""
    # no views of G: each would count references, which costs more than its row; nine sums at once read q but once
    for s in range(G.shape[0]):
        a, b, c, d, e, f, g, h, i = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(G.shape[2]):
            v = q[j]
            a += G[s, 0, j] * v
            b += G[s, 1, j] * v
            c += G[s, 2, j] * v
            d += G[s, 3, j] * v
            e += G[s, 4, j] * v
            f += G[s, 5, j] * v
            g += G[s, 6, j] * v
            h += G[s, 7, j] * v
            i += G[s, 8, j] * v
        strain[0, s], strain[1, s], strain[2, s] = a, b, c
        strain[3, s], strain[4, s], strain[5, s] = d, e, f
        strain[6, s], strain[7, s], strain[8, s] = g, h, i
    # none where no pin can move, so a solid that stands still pays nothing
    for s in range(lifted.shape[0]):
        for e in range(9):
            strain[e, s] += lifted[s, e]


@kernel(fastmath=REASSOCIATE)
def add_forces(G: Array, stress: Array, force: Array) -> None:
    """force += Σ G_sᵀ P_s for the stresses (9, c)."""
    for s in range(G.shape[0]):
        a, b, c, d, e = stress[0, s], stress[1, s], stress[2, s], stress[3, s], stress[4, s]
        f, g, h, i = stress[5, s], stress[6, s], stress[7, s], stress[8, s]
        for j in range(G.shape[2]):
            # in pairs: sums that do not wait for each other, in one order for every width of the vector unit
            force[j] += (
                ((a * G[s, 0, j] + b * G[s, 1, j]) + (c * G[s, 2, j] + d * G[s, 3, j]))
                + ((e * G[s, 4, j] + f * G[s, 5, j]) + (g * G[s, 6, j] + h * G[s, 7, j]))
                + i * G[s, 8, j]
            )  # fmt: skip


@kernel()
def _add_elastic(model: Reduced, q: Array, strain: Array, force: Array) -> float:
    """Energy of all points; adds Σ w_s G_sᵀ P_s to `force` where it is finite."""
    strains(model.G, q, model.lifted, strain)
    # the strain is not needed again, so the stresses take its place
    value = weighted_stresses(model.kind, strain, model.weights, model.mu, model.lam)
    if value < math.inf:
        add_forces(model.G, strain, force)
    return value


@kernel()
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


@kernel()
def value_gradient(model: Reduced, springs: Springs, predictor: Array, z: Array, work: Work, gradient: Array) -> float:
    """E(z), J, and its gradient, N; q = φ(z) is left in work.q."""
    q, force, offset = work.q, work.force, work.offset
    decode(model.layers, z, work.hidden, q)
    value = 0.0
    k = q.shape[0]
    for j in range(k):
        offset[j] = q[j] - predictor[j]
    for j in range(k):
        # a basis orthonormal in the mass has a diagonal M̃, which saves k² products
        momentum = model.inertia[0, j] * offset[j] if model.inertia.shape[0] == 1 else inner(model.inertia[j], offset)
        force[j] = momentum - model.force[j]
        value += 0.5 * offset[j] * momentum - model.force[j] * q[j]
    value += _add_springs(springs, q, force)
    value += _add_elastic(model, q, work.strain, force)
    # an infinite value is only backed away from: nobody reads its gradient
    if value < math.inf:
        decode_vjp(model.layers, work.hidden, force, work.scratch, gradient)
    return value
