"""The boundary of a volume mesh, for drawing and for picking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.mesh.mesh import Mesh

# Faces of a right-handed cell, counter-clockwise seen from outside.
CELL_FACES = {
    "tet4": np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
    "hex8": np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]),
}


def boundary_faces(mesh: Mesh) -> NDArray[np.int32]:
    """Faces that belong to one cell only, (f, 3) for tet4 or (f, 4) for hex8, int32, outward for right-handed cells."""
    faces = mesh.cells[:, CELL_FACES[mesh.cell_type]].reshape(-1, CELL_FACES[mesh.cell_type].shape[1])
    corners = np.sort(faces, axis=1)
    order = np.lexsort(corners.T)
    same = (corners[order][1:] == corners[order][:-1]).all(axis=1)
    shared = np.zeros(len(faces), dtype=bool)
    shared[order[1:]] |= same
    shared[order[:-1]] |= same
    return faces[~shared]


def surface_triangles(mesh: Mesh) -> NDArray[np.int32]:
    """The boundary as triangles, (t, 3) int32 vertex indices, outward for right-handed cells; quads are cut in two."""
    faces = boundary_faces(mesh)
    if faces.shape[1] == 3:
        return faces
    return np.ascontiguousarray(faces[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3))


def surface_vertices(mesh: Mesh) -> NDArray[np.int32]:
    """The vertices on the boundary, (v,) int32, ascending."""
    return np.unique(boundary_faces(mesh))


def coarsened(positions: Array, triangles: NDArray[np.integer], limit: int) -> NDArray[np.int32]:
    """Triangles between at most `limit` of the vertices, by clustering (Rossignac and Borrel 1993).

    The vertices in one cell of a grid become the one nearest to their mean, and triangles that lose their area vanish.
    For pictures: thin parts may grow together, and the surface need not stay a manifold.

    Args:
        positions: of all vertices, (n, 3).
        triangles: vertex indices, (t, 3).
        limit: a surface of no more vertices is returned as it is.

    Returns:
        Vertex indices, (t', 3) int32, in the numbering of `positions`.
    """
    used = np.unique(triangles)
    if len(used) <= limit:
        return triangles.astype(np.int32)
    points = positions[used] - positions[used].min(axis=0)
    cell = float(points.max()) / np.sqrt(limit)
    while True:
        _, cluster = np.unique((points / cell).astype(np.int64), axis=0, return_inverse=True)
        if cluster.max() < limit:
            break
        cell *= 1.05
    sums = np.stack([np.bincount(cluster, points[:, axis]) for axis in range(3)], axis=1)
    off = np.linalg.norm(points - (sums / np.bincount(cluster)[:, None])[cluster], axis=1)
    order = np.lexsort((off, cluster))
    chosen = used[order[np.searchsorted(cluster[order], np.arange(cluster.max() + 1))]]
    merged = chosen[cluster[np.searchsorted(used, triangles)]]
    whole = (merged != np.roll(merged, 1, axis=1)).all(axis=1)
    first = np.argmin(merged[whole], axis=1)
    turned = np.take_along_axis(merged[whole], (first[:, None] + np.arange(3)) % 3, axis=1)
    return np.unique(turned, axis=0).astype(np.int32)


@dataclass(frozen=True, eq=False)
class Surface:
    """The boundary of a mesh with its own numbering, for drawing and picking.

    Attributes:
        vertices: the mesh's vertices on it, (v,) int64, ascending.
        rest: their rest positions, (v, 3) float64, metres.
        triangles: (t, 3) int32 indices into `vertices`, counter-clockwise seen from outside.
    """

    vertices: Indices
    rest: Array
    triangles: NDArray[np.int32]

    @classmethod
    def of(cls, mesh: Mesh, most_vertices: int | None = None) -> Surface:
        """The boundary of a mesh, `coarsened` where it has more vertices than are allowed."""
        triangles = surface_triangles(mesh)
        if most_vertices is not None:
            triangles = coarsened(mesh.vertices, triangles, most_vertices)
        vertices, local = np.unique(triangles, return_inverse=True)
        return cls(
            vertices.astype(np.int64),
            mesh.vertices[vertices],
            local.reshape(triangles.shape).astype(np.int32),
        )
