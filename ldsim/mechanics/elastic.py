"""Compiled loops over quadrature points: elastic energy, forces and stiffness of the full space.

F_s = I + Σ_a u_a ⊗ ∇N_a;  V = Σ_s w_s Ψ(F_s);  ∂V/∂u_a = Σ_s w_s P_s ∇N_a;  K_ab = Σ_s w_s ∇N_a · ∂²Ψ/∂F² · ∇N_b.
Serial and on scalars: two 3×3 temporaries inside the loop cost a factor of sixty, as a prototype measured. Points stay
in the order of the cells, whatever their materials: it is the order of the sums, which stored results depend on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.jit import kernel, njit
from ldsim.mechanics.materials.kernels import energy, energy_stress, tangent
from ldsim.mechanics.materials.tensors import Matrix, determinant, product_transposed, signed_svd

# Of second differences the length in strain; and the share of the most energy of a point that is nothing beside it.
SHORT, FADED = 1e-3, 1e-6
# Of three things all pairs.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class Elements(NamedTuple):
    """What the kernels read: quadrature points with their material.

    nodes (s, a) int32, gradients (s, a, 3) 1/m, weights (s,) m³, kind (s,) int8, mu and lam (s,) Pa.
    """

    nodes: NDArray[np.int32]
    gradients: Array
    weights: Array
    kind: NDArray[np.int8]
    mu: Array
    lam: Array


def elements_at(elements: Elements, points: Indices) -> Elements:
    """Some of the quadrature points, (c,), as the kernels read them."""
    return Elements._make(values[points] for values in elements)


@njit(cache=True, inline="always")
def deformation_gradient(nodes: NDArray[np.int32], gradients: Array, s: int, u: Array) -> Matrix:
    """F_s = I + Σ_a u_a ⊗ ∇N_a at point s; u is (n, 3)."""
    f00, f01, f02, f10, f11, f12, f20, f21, f22 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for a in range(nodes.shape[1]):
        v = nodes[s, a]
        x, y, z = u[v, 0], u[v, 1], u[v, 2]
        g0, g1, g2 = gradients[s, a, 0], gradients[s, a, 1], gradients[s, a, 2]
        f00 += x * g0
        f01 += x * g1
        f02 += x * g2
        f10 += y * g0
        f11 += y * g1
        f12 += y * g2
        f20 += z * g0
        f21 += z * g1
        f22 += z * g2
    return f00, f01, f02, f10, f11, f12, f20, f21, f22


@njit(cache=True, nogil=True)
def elastic_energy(elements: Elements, u: Array) -> float:
    """V(u) = Σ_s w_s Ψ(F_s), J; u is (n, 3) in metres. Infinite where a material does not allow inversion."""
    total = 0.0
    for s in range(elements.weights.shape[0]):
        F = deformation_gradient(elements.nodes, elements.gradients, s, u)
        total += elements.weights[s] * energy(elements.kind[s], F, elements.mu[s], elements.lam[s])
    return total


@kernel()
def add_elastic_gradient(elements: Elements, u: Array, gradient: Array) -> float:
    """Adds ∂V/∂u, N, to `gradient` (n, 3) and returns V(u), J; stops at the first infinite density."""
    total = 0.0
    for s in range(elements.weights.shape[0]):
        F = deformation_gradient(elements.nodes, elements.gradients, s, u)
        density, P = energy_stress(elements.kind[s], F, elements.mu[s], elements.lam[s])
        # a line search steps back from here, whatever the other points say
        if density == np.inf:
            return density
        w = elements.weights[s]
        total += w * density
        for a in range(elements.nodes.shape[1]):
            v = elements.nodes[s, a]
            g0 = w * elements.gradients[s, a, 0]
            g1 = w * elements.gradients[s, a, 1]
            g2 = w * elements.gradients[s, a, 2]
            gradient[v, 0] += P[0] * g0 + P[1] * g1 + P[2] * g2
            gradient[v, 1] += P[3] * g0 + P[4] * g1 + P[5] * g2
            gradient[v, 2] += P[6] * g0 + P[7] * g1 + P[8] * g2
    return total


@njit(cache=True, nogil=True)
def point_stresses(elements: Elements, u: Array, stresses: Array) -> None:
    """Writes the first Piola–Kirchhoff stress of every point, Pa, into `stresses` (s, 9)."""
    for s in range(elements.weights.shape[0]):
        F = deformation_gradient(elements.nodes, elements.gradients, s, u)
        _, P = energy_stress(elements.kind[s], F, elements.mu[s], elements.lam[s])
        for i in range(9):
            stresses[s, i] = P[i]


@njit(cache=True, nogil=True)
def smallest_volume_ratio(elements: Elements, u: Array) -> tuple[int, float]:
    """The point where det F is smallest and its value; the first where it is not a number, if there is one."""
    worst, smallest = 0, np.inf
    for s in range(elements.weights.shape[0]):
        J = determinant(deformation_gradient(elements.nodes, elements.gradients, s, u))
        if np.isnan(J):  # every comparison with it is false, so it would be passed over
            return s, J
        if J < smallest:
            worst, smallest = s, J
    return worst, smallest


@njit(cache=True, nogil=True)
def add_elastic_stiffness(elements: Elements, u: Array, slots: Indices, clamp: bool, blocks: Array) -> None:
    """Adds the tangent stiffness, N/m, to 3×3 `blocks` (b, 3, 3).

    `slots[s, a, b]` is the block of the pair of nodes a, b of point s, or −1 where one of them is pinned. In the
    frame of the singular vectors the tangent is sparse, so a block is K_ab = U [C : (Vᵀ∇N_a) (Vᵀ∇N_b)] Uᵀ.
    """
    nodes_per_point = elements.nodes.shape[1]
    # made once, not for each point: k = C : (Vᵀ∇N_a) (Vᵀ∇N_b), t = U k, h = Vᵀ∇N of every node
    k = np.empty((3, 3))
    t = np.empty((3, 3))
    h = np.empty((nodes_per_point, 3))
    for s in range(elements.weights.shape[0]):
        F = deformation_gradient(elements.nodes, elements.gradients, s, u)
        U, V, D, O = tangent(elements.kind[s], F, elements.mu[s], elements.lam[s], clamp)
        w = elements.weights[s]
        for a in range(nodes_per_point):
            g0, g1, g2 = elements.gradients[s, a, 0], elements.gradients[s, a, 1], elements.gradients[s, a, 2]
            h[a, 0] = V[0] * g0 + V[3] * g1 + V[6] * g2
            h[a, 1] = V[1] * g0 + V[4] * g1 + V[7] * g2
            h[a, 2] = V[2] * g0 + V[5] * g1 + V[8] * g2
        # both triangles: symmetric only as a whole, and half the pairs would need a second slot each
        for a in range(nodes_per_point):
            a0, a1, a2 = w * h[a, 0], w * h[a, 1], w * h[a, 2]
            for b in range(nodes_per_point):
                slot = slots[s, a, b]
                if slot < 0:  # a pinned node has no unknowns
                    continue
                b0, b1, b2 = h[b, 0], h[b, 1], h[b, 2]
                k[0, 0] = D[0] * a0 * b0 + O[0] * a1 * b1 + O[1] * a2 * b2
                k[1, 1] = D[1] * a1 * b1 + O[0] * a0 * b0 + O[2] * a2 * b2
                k[2, 2] = D[2] * a2 * b2 + O[1] * a0 * b0 + O[2] * a1 * b1
                k[0, 1] = D[3] * a0 * b1 + O[3] * a1 * b0
                k[1, 0] = D[3] * a1 * b0 + O[3] * a0 * b1
                k[0, 2] = D[4] * a0 * b2 + O[4] * a2 * b0
                k[2, 0] = D[4] * a2 * b0 + O[4] * a0 * b2
                k[1, 2] = D[5] * a1 * b2 + O[5] * a2 * b1
                k[2, 1] = D[5] * a2 * b1 + O[5] * a1 * b2
                for i in range(3):
                    for j in range(3):
                        t[i, j] = U[3 * i] * k[0, j] + U[3 * i + 1] * k[1, j] + U[3 * i + 2] * k[2, j]
                for i in range(3):
                    for j in range(3):
                        blocks[slot, i, j] += t[i, 0] * U[3 * j] + t[i, 1] * U[3 * j + 1] + t[i, 2] * U[3 * j + 2]


@njit(cache=True, nogil=True)
def third_derivative(elements: Elements, fields: Array) -> Array:
    """∂³V/∂u³ at rest along two of three fields, (n, 3, 3) with the field last: forces (n, 3, 6), `PAIRS` last, J/m³.

    Of each point the second differences of its stress along the fields and their sums, exact to `SHORT` squared, for
    no material says its third derivatives. The fields are of forces at a place, and fade from there; points where they
    have faded are left out.
    """
    points = elements.weights.shape[0]
    size, largest, forces = np.empty(points), 0.0, np.zeros((fields.shape[0], 3, 6))
    G, bent = np.empty((3, 9)), np.empty((6, 9))
    for s in range(points):
        size[s] = elements.weights[s] * _strains(elements, s, fields, G) ** 2
        largest = max(largest, size[s])
    for s in range(points):
        if size[s] <= FADED * largest:
            continue
        h = SHORT / _strains(elements, s, fields, G)
        _second_differences(elements.kind[s], elements.mu[s], elements.lam[s], G, h, bent)
        scale = elements.weights[s] / h**2
        for pair in range(5, -1, -1):
            i, j = PAIRS[pair]
            for e in range(9):
                # of two fields together half of their sum's less those of each
                bent[pair, e] = scale * (bent[pair, e] if i == j else 0.5 * (bent[pair, e] - bent[i, e] - bent[j, e]))
        for a in range(elements.nodes.shape[1]):
            v, g = elements.nodes[s, a], elements.gradients[s, a]
            for i in range(3):
                for pair in range(6):
                    row = bent[pair]
                    forces[v, i, pair] += row[3 * i] * g[0] + row[3 * i + 1] * g[1] + row[3 * i + 2] * g[2]
    return forces


@njit(cache=True, inline="always")
def _strains(elements: Elements, s: int, fields: Array, G: Array) -> float:
    """Writes ∇ of each field at point s, (3, 9), and returns the norm of all."""
    G[:] = 0.0
    for a in range(elements.nodes.shape[1]):
        v = elements.nodes[s, a]
        for f in range(3):
            for i in range(3):
                for j in range(3):
                    G[f, 3 * i + j] += fields[v, i, f] * elements.gradients[s, a, j]
    total = 0.0
    for f in range(3):
        for e in range(9):
            total += G[f, e] ** 2
    return math.sqrt(total)


@njit(cache=True, inline="always")
def _second_differences(kind: int, mu: float, lam: float, G: Array, h: float, bent: Array) -> None:
    """P(I + h H) − 2 P(I) + P(I − h H) for H of each of three, and of the sums of two."""
    _, P = energy_stress(kind, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), mu, lam)
    for row in range(6):
        i, j = PAIRS[row]
        own = h if i == j else 0.0  # of the first alone, or of the sum; what is not made into arrays is not allocated
        for e in range(9):
            bent[row, e] = -2.0 * P[e]
        for sign in (-1.0, 1.0):
            a, b = sign * (h - own), sign * h
            F = (
                1.0 + a * G[i, 0] + b * G[j, 0], a * G[i, 1] + b * G[j, 1], a * G[i, 2] + b * G[j, 2],
                a * G[i, 3] + b * G[j, 3], 1.0 + a * G[i, 4] + b * G[j, 4], a * G[i, 5] + b * G[j, 5],
                a * G[i, 6] + b * G[j, 6], a * G[i, 7] + b * G[j, 7], 1.0 + a * G[i, 8] + b * G[j, 8],
            )  # fmt: skip
            _, stress = energy_stress(kind, F, mu, lam)
            for e in range(9):
                bent[row, e] += stress[e]


@njit(cache=True, nogil=True)
def vertex_rotations(elements: Elements, u: Array, rotations: Array) -> None:
    """Writes each vertex's rotation into `rotations` (n, 3, 3): the polar factor of Σ w_s F_s over its points."""
    rotations[:] = 0.0
    for s in range(elements.weights.shape[0]):
        F = deformation_gradient(elements.nodes, elements.gradients, s, u)
        for a in range(elements.nodes.shape[1]):
            v = elements.nodes[s, a]
            for i in range(3):
                for j in range(3):
                    rotations[v, i, j] += elements.weights[s] * F[3 * i + j]
    for v in range(rotations.shape[0]):
        A = rotations[v]
        U, _, V = signed_svd((A[0, 0], A[0, 1], A[0, 2], A[1, 0], A[1, 1], A[1, 2], A[2, 0], A[2, 1], A[2, 2]))
        R = product_transposed(U, V)
        A[0, 0], A[0, 1], A[0, 2] = R[0], R[1], R[2]
        A[1, 0], A[1, 1], A[1, 2] = R[3], R[4], R[5]
        A[2, 0], A[2, 1], A[2, 2] = R[6], R[7], R[8]
