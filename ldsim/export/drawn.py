"""What is drawn of a solid: its boundary, or a surface of the user's own that is bound to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ldsim.arrays import Array, Indices
from ldsim.mesh.embedding import embedding
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.skin import Skin
from ldsim.mesh.surface import Surface


@dataclass(frozen=True, eq=False)
class Drawn:
    """A surface that moves with a mesh.

    Attributes:
        rest: positions, (v, 3) float64, metres.
        triangles: (t, 3), outward.
        skin: texture coordinates, normals and looks; None for the mesh's own boundary.
        places: which vertices lie where: of each the number of its place, (v,). Those of one place share their normal
            where the skin says nothing of it.
    """

    rest: Array
    triangles: NDArray[np.int32]
    skin: Skin | None
    places: Indices
    _carry: csr_array

    @classmethod
    def of(cls, mesh: Mesh, skin: Skin | None) -> Drawn:
        """Of a mesh with a skin, or of its boundary.

        Raises:
            MeshError: the skin lies far outside of the mesh.
        """
        if skin is not None:
            places = np.unique(skin.positions, axis=0, return_inverse=True)[1].ravel()
            carry = embedding(mesh, skin.positions)
            return cls(skin.positions, skin.triangles.astype(np.int32), skin, places, carry)
        surface = Surface.of(mesh)
        v = len(surface.vertices)
        carry = csr_array((np.ones(v), surface.vertices, np.arange(v + 1)), shape=(v, mesh.n_vertices))
        return cls(surface.rest, surface.triangles, None, np.arange(v), carry)

    def moved(self, field: Array) -> Array:
        """A field of the mesh's vertices, (n, 3) or (n, 3, k), at its own, (v, 3) or (v, 3, k)."""
        found: Array = (self._carry @ field.reshape(len(field), -1)).reshape(-1, *field.shape[1:])
        return found

    @property
    def normals(self) -> Array:
        """(v, 3) float64, unit: the skin's own, or of the triangles around each place."""
        if self.skin is not None and self.skin.normals is not None:
            return self.skin.normals
        return self._at_places(vertex_normals(*self._joined(self.rest)))

    def normal_derivative(self, direction: Array) -> Array:
        """How normals turn where the surface moves along a field, (v, 3), to first order."""
        rest, triangles = self._joined(self.rest)
        return self._at_places(normal_derivative(rest, triangles, self._joined(direction)[0]))

    def _joined(self, field: Array) -> tuple[Array, NDArray[np.int32]]:
        first = np.unique(self.places, return_index=True)[1]
        return field[first], self.places[self.triangles].astype(np.int32)

    def _at_places(self, values: Array) -> Array:
        return values[self.places]


def _area_vectors(a: Array, b: Array, triangles: NDArray[np.int32]) -> Array:
    """Σ (a₁ − a₀) × (b₂ − b₀) over the triangles of each vertex, (v, 3), of two fields there, (v, 3)."""
    (p, q, _), (r, _, s) = (np.moveaxis(field[triangles], 1, 0) for field in (a, b))
    total = np.zeros_like(a)
    for corner in triangles.T:
        np.add.at(total, corner, np.cross(q - p, s - r))
    return total


def vertex_normals(positions: Array, triangles: NDArray[np.int32]) -> Array:
    """Unit normals n = N / ‖N‖ with N the sum of the triangles' area vectors, (v, 3) float64; z where that is zero."""
    N = _area_vectors(positions, positions, triangles)
    sizes = np.linalg.norm(N, axis=1, keepdims=True)
    normals: Array = np.where(sizes > 0, N / np.maximum(sizes, 1e-300), (0.0, 0.0, 1.0))
    return normals


def normal_derivative(positions: Array, triangles: NDArray[np.int32], direction: Array) -> Array:
    """∂n/∂x · direction, (v, 3) float64: (I − n nᵀ) dN / ‖N‖."""
    N = _area_vectors(positions, positions, triangles)
    change = _area_vectors(direction, positions, triangles) + _area_vectors(positions, direction, triangles)
    length = np.maximum(np.linalg.norm(N, axis=1, keepdims=True), 1e-300)
    n = N / length
    turned: Array = (change - n * np.einsum("vi,vi->v", n, change)[:, None]) / length
    return turned
