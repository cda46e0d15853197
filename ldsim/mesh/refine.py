"""Uniform refinement of tet meshes."""

from __future__ import annotations

import numpy as np

from ldsim.arrays import Indices
from ldsim.errors import MeshError
from ldsim.mesh.mesh import Group, Mesh

CHILDREN = 8
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
# Children as numbers of the four corners (0–3) and of the edges' midpoints (4–9, in the order of EDGES).
CORNER_CHILDREN = np.array([[0, 4, 5, 6], [4, 1, 7, 8], [5, 7, 2, 9], [6, 8, 9, 3]])
# The octahedron left in the middle, cut around the diagonal 4–9, 5–8 or 6–7.
INNER_CHILDREN = np.array(
    [
        [[4, 9, 5, 6], [4, 9, 6, 8], [4, 9, 8, 7], [4, 9, 7, 5]],
        [[5, 8, 6, 4], [5, 8, 4, 7], [5, 8, 7, 9], [5, 8, 9, 6]],
        [[6, 7, 4, 5], [6, 7, 5, 9], [6, 7, 9, 8], [6, 7, 8, 4]],
    ]
)


def refined(mesh: Mesh) -> Mesh:
    """The mesh with each tet cut into eight of equal volume, the old vertices first.

    Four children sit in the corners, four around the shortest diagonal of the octahedron between them, which keeps
    their shape from getting worse with each refinement (Bey 1995, "Tetrahedral grid refinement", Sec. 3). Children
    have the handedness of their parent; faces are cut alike from both sides.

    Raises:
        MeshError: the mesh is not of tets.
    """
    if mesh.cell_type != "tet4":
        raise MeshError(f"cells are {mesh.cell_type}; only tet4 meshes can be refined")
    ends = np.sort(mesh.cells[:, EDGES].astype(np.int64), axis=2)
    keys, edge = np.unique(ends[..., 0] * mesh.n_vertices + ends[..., 1], return_inverse=True)
    first, second = np.divmod(keys, mesh.n_vertices)
    vertices = np.concatenate([mesh.vertices, (mesh.vertices[first] + mesh.vertices[second]) / 2])
    points = np.concatenate([mesh.cells, mesh.n_vertices + edge.reshape(-1, 6)], axis=1)
    diagonals = vertices[points[:, [4, 5, 6]]] - vertices[points[:, [9, 8, 7]]]
    shortest = np.linalg.norm(diagonals, axis=2).argmin(axis=1)
    corner = points[:, CORNER_CHILDREN]
    inner = np.take_along_axis(points, INNER_CHILDREN[shortest].reshape(-1, 16), axis=1).reshape(-1, 4, 4)
    ends_of = np.stack([first, second])
    groups = {name: _refined_group(group, mesh.n_vertices, ends_of) for name, group in mesh.groups.items()}
    return Mesh(vertices, np.concatenate([corner, inner], axis=1).reshape(-1, 4), "tet4", groups)


def _refined_group(group: Group, n_vertices: int, ends: Indices) -> Group:
    """The group with the children of its cells; `ends` (2, e) are the vertices that each midpoint lies between."""
    inside = np.zeros(n_vertices, dtype=bool)
    inside[group.vertices] = True
    midpoints = n_vertices + np.flatnonzero(inside[ends].all(axis=0))
    children = (CHILDREN * group.cells[:, None] + np.arange(CHILDREN)).ravel()
    return Group(np.concatenate([group.vertices, midpoints]), children)
