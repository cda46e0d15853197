"""The volume mesh: vertices, cells of one type, and the checks that make it fit to simulate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ldsim.arrays import Array, Indices
from ldsim.errors import MeshError

NODES_PER_CELL = {"tet4": 4, "hex8": 8}
# The volume of a cell that is degenerate, as a share of its longest edge cubed.
DEGENERATE = 1e-12
# The largest coordinate, metres: the cube of a length, and what is made of it, stays far from overflow.
FARTHEST = 1e9
# Vertices nearer than this share of the diagonal are one: single precision, as STL stores it, and no more.
MERGE_DISTANCE = 1e-6

# The corner a of a cell and the three corners that make a right-handed frame with it.
CORNER_FRAMES = {
    "tet4": np.array([[0, 1, 2, 3]]),
    "hex8": np.array(
        [
            [0, 1, 3, 4],
            [1, 2, 0, 5],
            [2, 3, 1, 6],
            [3, 0, 2, 7],
            [4, 7, 5, 0],
            [5, 4, 6, 1],
            [6, 5, 7, 2],
            [7, 6, 4, 3],
        ]
    ),
}


@dataclass(frozen=True, eq=False)
class Group:
    """A named part of a mesh, as its file defines it.

    Attributes:
        vertices: all vertices of the part, (v,) int64, ascending.
        cells: the cells of the part, (c,) int64, ascending; none where the part is of faces, edges or points.
    """

    vertices: Indices
    cells: Indices


@dataclass(frozen=True, eq=False)
class Mesh:
    """A volume mesh of one cell type.

    Attributes:
        vertices: rest positions, (n, 3) float64, metres.
        cells: vertex indices, (m, 4) for tet4 or (m, 8) for hex8, int32, in VTK's order.
        cell_type: "tet4" or "hex8".
        groups: named parts of it.

    Raises:
        MeshError: on a wrong shape, a coordinate that is not finite, or an index out of range.
    """

    vertices: Array
    cells: NDArray[np.int32]
    cell_type: str
    groups: Mapping[str, Group] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.cell_type not in NODES_PER_CELL:
            raise MeshError(f"cell type {self.cell_type!r} is not one of {', '.join(NODES_PER_CELL)}")
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        cells = np.asarray(self.cells)
        if cells.size and cells.dtype.kind not in "iu":
            raise MeshError(f"cells are of type {cells.dtype}; expected whole numbers of vertices")
        check_indices(vertices, cells, NODES_PER_CELL[self.cell_type], "cell", "m")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "cells", np.ascontiguousarray(cells, dtype=np.int32))

    @property
    def n_vertices(self) -> int:
        return len(self.vertices)

    @property
    def n_cells(self) -> int:
        return len(self.cells)

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal, metres."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))


def check_indices(vertices: Array, cells: NDArray[np.integer], nodes: int, what: str, count: str) -> None:
    """Refuse vertices, (n, 3), or what refers to them, (count, nodes), that make no mesh; `what` is one of these.

    Raises:
        MeshError: on a wrong shape, a place that is not finite or so far away that volumes overflow, or an index out
            of range.
    """
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) == 0:
        raise MeshError(f"vertices have shape {vertices.shape}; expected (n, 3) with n > 0")
    if cells.ndim != 2 or cells.shape[1] != nodes or len(cells) == 0:
        raise MeshError(f"{what}s have shape {cells.shape}; expected ({count}, {nodes}) with {count} > 0")
    far = ~(np.abs(vertices) <= FARTHEST).all(axis=1)
    if far.any():
        row = int(far.argmax())
        raise MeshError(
            f"vertex {row} has coordinates {vertices[row].tolist()}; all must be finite numbers of at most "
            f"{FARTHEST:g} m; is mesh.scale right?"
        )
    if cells.min() < 0 or cells.max() >= len(vertices):
        row = int(np.argwhere((cells < 0) | (cells >= len(vertices)))[0, 0])
        raise MeshError(f"{what} {row} refers to vertices {cells[row].tolist()}; allowed are 0 … {len(vertices) - 1}")


def corner_volumes(mesh: Mesh) -> Array:
    """Signed volume at each corner of each cell, (m, corners) float64, m³.

    The parallelepiped of the corner's edges; a sixth of it for tet4, so that the one corner gives the cell's
    volume. All positive means a right-handed cell that is nowhere folded.
    """
    frames = CORNER_FRAMES[mesh.cell_type]
    x = mesh.vertices[mesh.cells[:, frames]]
    edges = x[:, :, 1:] - x[:, :, :1]
    scale = 1 / 6 if mesh.cell_type == "tet4" else 1.0
    volumes: Array = np.linalg.det(edges) * scale
    return volumes


def check_cells(mesh: Mesh) -> None:
    """Refuse inverted and degenerate cells, and those listed twice.

    Raises:
        MeshError: naming the first cell whose corner volume is negative (inverted) or at most
            `DEGENERATE` times its longest edge cubed (degenerate), or that has the vertices of another.
    """
    corners = np.sort(mesh.cells, axis=1)
    _, first_of = np.unique(corners, axis=0, return_index=True)
    if len(first_of) < mesh.n_cells:
        twice = np.setdiff1d(np.arange(mesh.n_cells), first_of)
        raise MeshError(
            f"{len(twice)} of {mesh.n_cells} cells are there twice, the first is cell {twice[0]} with vertices "
            f"{mesh.cells[twice[0]].tolist()}; each would add its mass and stiffness again, so leave one"
        )
    volumes = corner_volumes(mesh).min(axis=1)
    extent = np.ptp(mesh.vertices[mesh.cells], axis=1).max(axis=1)
    degenerate = ~(np.abs(volumes) > DEGENERATE * extent**3)  # also where a volume overflows
    inverted = (volumes < 0) & ~degenerate
    for name, bad in (("degenerate", degenerate), ("inverted", inverted)):
        if bad.any():
            first = int(np.flatnonzero(bad)[0])
            raise MeshError(
                f"{int(bad.sum())} of {mesh.n_cells} cells are {name}, the first is cell {first} with vertices "
                f"{mesh.cells[first].tolist()} and volume {volumes[first]:.3g} m³; volumes must be positive"
                + (" (set mesh.reorient: true to flip such cells)" if name == "inverted" else "")
            )


def reoriented(mesh: Mesh) -> Mesh:
    """The same mesh with left-handed cells flipped to right-handed ones."""
    left = corner_volumes(mesh).max(axis=1) < 0
    cells = mesh.cells.copy()
    mirror = [0, 2, 1, 3] if mesh.cell_type == "tet4" else [4, 5, 6, 7, 0, 1, 2, 3]
    cells[left] = cells[left][:, mirror]
    return replace(mesh, cells=cells)


def without_unused_vertices(mesh: Mesh) -> Mesh:
    """The same mesh with only the vertices that a cell uses, in their old order."""
    used = np.zeros(mesh.n_vertices, dtype=bool)
    used[mesh.cells] = True
    renumbered = np.cumsum(used) - 1
    groups = {
        name: Group(renumbered[group.vertices[used[group.vertices]]], group.cells)
        for name, group in mesh.groups.items()
        if used[group.vertices].any()
    }
    return Mesh(mesh.vertices[used], renumbered[mesh.cells].astype(np.int32), mesh.cell_type, groups)


def components(mesh: Mesh) -> NDArray[np.int32]:
    """The connected component of each vertex, (n,) int32, numbered from 0."""
    first = np.repeat(mesh.cells[:, :1], mesh.cells.shape[1] - 1, axis=1).ravel()
    other = mesh.cells[:, 1:].ravel()
    graph = coo_array((np.ones(len(first), dtype=np.int8), (first, other)), shape=(mesh.n_vertices,) * 2)
    return connected_components(graph, directed=False)[1].astype(np.int32)


def doubled_vertices(mesh: Mesh) -> int:
    """How many vertices lie where those of another connected part do, so that nothing joins the parts there."""
    labels = components(mesh)
    if not labels.any():
        return 0
    pairs = cKDTree(mesh.vertices).query_pairs(MERGE_DISTANCE * mesh.diagonal, output_type="ndarray")
    return len(np.unique(pairs[labels[pairs[:, 0]] != labels[pairs[:, 1]]]))


def doubled_words(count: int) -> str:
    """What is wrong where so many vertices are doubled, and what to do."""
    return (
        f"{count} vertices lie where vertices of another part do; the parts are not joined there: merge them in the "
        "program that made the mesh"
    )
