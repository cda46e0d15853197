"""Binds points to the cells of a mesh, so that they move with it.

Inside by barycentric coordinates, outside by those of the nearest cell: affine motions of the mesh, rigid ones among
them, move the points exactly so.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from ldsim.arrays import Array, Indices
from ldsim.errors import MeshError
from ldsim.mesh.mesh import Mesh

# A hexahedron as tets around the diagonal from its first corner to the one across.
TETS_OF_HEX = np.array([[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]])
# Cells that are tried for a point, by how near their centres are, and points at a time, for memory.
TRIED, BATCH = 48, 4096
# A point may lie this share of the mesh's diagonal outside of it.
REACH = 0.1


def embedding(mesh: Mesh, points: Array) -> csr_array:
    """P, (v, n): the positions of points (v, 3) from those of the vertices, and their displacements too.

    Raises:
        MeshError: a point lies far outside of the mesh.
    """
    tets = mesh.cells if mesh.cell_type == "tet4" else mesh.cells[:, TETS_OF_HEX].reshape(-1, 4)
    x = mesh.vertices[tets]
    edges = x[:, 1:] - x[:, :1]
    inverse = np.linalg.inv(edges)  # rows of coordinates 1 to 3 along x, y, z in its columns
    gradients = np.concatenate([-inverse.sum(axis=2)[:, None], inverse.transpose(0, 2, 1)], axis=1)
    tree, tried = cKDTree(x.mean(axis=1)), min(TRIED, len(tets))
    rows = [_bound(points[i : i + BATCH], x, gradients, tree, tried) for i in range(0, len(points), BATCH)]
    cell, weights, outside = (np.concatenate(each) for each in zip(*rows, strict=True))
    if outside.max() > REACH * mesh.diagonal:
        worst = int(outside.argmax())
        raise MeshError(
            f"point {worst} of the surface lies {outside[worst]:.4g} m outside of the mesh, at "
            f"{np.round(points[worst], 4).tolist()}; allowed are {REACH * mesh.diagonal:.4g} m "
            "(a tenth of its diagonal): give the surface that the solid was made of, in the unit of mesh.scale"
        )
    start = np.arange(0, 4 * len(points) + 1, 4)
    return csr_array((weights.ravel(), tets[cell].ravel(), start), shape=(len(points), mesh.n_vertices))


def _bound(points: Array, x: Array, gradients: Array, tree: cKDTree, tried: int) -> tuple[Indices, Array, Array]:
    """The cell of each point, its barycentric coordinates there, and how far outside of it the point is."""
    near = tree.query(points, k=tried)[1].reshape(len(points), tried)
    slopes = gradients[near]
    share = np.einsum("pcix,pcx->pci", slopes, points[:, None] - x[near, 0])
    share[..., 0] += 1.0
    # a coordinate below zero is so many heights of the cell outside of one of its faces
    outside = np.maximum(-share / np.linalg.norm(slopes, axis=3), 0.0).max(axis=2)
    best = outside.argmin(axis=1)
    rows = np.arange(len(points))
    return near[rows, best], share[rows, best], outside[rows, best]
