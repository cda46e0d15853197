"""Energy density and stress at quadrature points and at vertices."""

from __future__ import annotations

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.jit import njit
from ldsim.mechanics.elastic import Elements, deformation_gradient
from ldsim.mechanics.materials.kernels import energy_stress
from ldsim.mechanics.materials.tensors import determinant
from ldsim.mechanics.scene import Scene

FIELDS = ("energy", "stress")


@njit(cache=True, nogil=True)
def energy_and_stress(elements: Elements, points: Indices, u: Array, values: Array) -> None:
    """Writes Ψ, J/m³, and the von Mises stress of σ = P Fᵀ / det F, Pa, of the given points into `values` (2, p)."""
    for i in range(points.shape[0]):
        s = points[i]
        F = deformation_gradient(elements.nodes, elements.gradients, s, u)
        values[0, i], P = energy_stress(elements.kind[s], F, elements.mu[s], elements.lam[s])
        J = determinant(F)
        xx = (P[0] * F[0] + P[1] * F[1] + P[2] * F[2]) / J
        yy = (P[3] * F[3] + P[4] * F[4] + P[5] * F[5]) / J
        zz = (P[6] * F[6] + P[7] * F[7] + P[8] * F[8]) / J
        xy = (P[0] * F[3] + P[1] * F[4] + P[2] * F[5]) / J
        xz = (P[0] * F[6] + P[1] * F[7] + P[2] * F[8]) / J
        yz = (P[3] * F[6] + P[4] * F[7] + P[5] * F[8]) / J
        deviation = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2 + 6 * (xy * xy + xz * xz + yz * yz)
        values[1, i] = np.sqrt(0.5 * deviation)


class VertexField:
    """Averages over the quadrature points that touch each of some vertices (v,), by volume."""

    def __init__(self, scene: Scene, vertices: Indices) -> None:
        self._elements = scene.elements
        local = np.full(scene.mesh.n_vertices, -1)
        local[vertices] = np.arange(len(vertices))
        nodes = local[self._elements.nodes]
        self._points = np.flatnonzero((nodes >= 0).any(axis=1))
        # of the pairs of a point and a vertex that it touches: elsewhere 0 times an infinite Ψ would not be 0
        self._row, column = np.nonzero(nodes[self._points] >= 0)
        self._place = nodes[self._points[self._row], column]
        self._share = self._elements.weights[self._points[self._row]]
        self._total = np.bincount(self._place, self._share, len(vertices))

    def __call__(self, field: str, u: Array, material_scale: float = 1.0) -> Array:
        """One of `FIELDS` at every one of the vertices, (v,), at the displacement u, (n, 3) metres.

        Not finite at the vertices of a cell in a state that its material forbids, such as an inverted one.
        """
        values = np.empty((2, len(self._points)))
        energy_and_stress(self._elements, self._points, u, values)
        at_points = material_scale * values[FIELDS.index(field)]
        return np.bincount(self._place, self._share * at_points[self._row], len(self._total)) / self._total
