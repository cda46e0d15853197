"""Quadrature points, all that the mechanics sees of a mesh, and the mass matrix, M_ab = ∫ ρ N_a N_b dX for each axis.

Point s has nodes, shape-function gradients ∂N_a/∂X (1/m) and a weight (m³): one point a tet4, 2×2×2 a hex8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ldsim.arrays import Array
from ldsim.errors import MeshError
from ldsim.mesh.mesh import Mesh

GAUSS = 1 / np.sqrt(3)
HEX_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], dtype=float
)
TET_REFERENCE_GRADIENTS = np.array([[-1, -1, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)


@dataclass(frozen=True, eq=False)
class Quadrature:
    """The quadrature points of a mesh.

    Attributes:
        nodes: vertices of each point, (s, a) int32.
        gradients: ∂N_a/∂X, (s, a, 3) float64, 1/m.
        weights: volume of each point, (s,) float64, m³.
        cells: the cell of each point, (s,) int32.
    """

    nodes: NDArray[np.int32]
    gradients: Array
    weights: Array
    cells: NDArray[np.int32]

    @property
    def n_points(self) -> int:
        return len(self.weights)


def reference_points(cell_type: str) -> tuple[Array, Array, Array]:
    """Shape functions (p, a), their reference gradients (p, a, 3) and weights (p,) at a cell's points."""
    if cell_type == "tet4":
        return np.full((1, 4), 0.25), TET_REFERENCE_GRADIENTS[None], np.array([1 / 6])
    xi = HEX_CORNERS * GAUSS
    factors = 1 + xi[:, None, :] * HEX_CORNERS[None]
    shape = factors.prod(axis=2) / 8
    gradients = np.empty((8, 8, 3))
    for axis in range(3):
        others = [i for i in range(3) if i != axis]
        gradients[:, :, axis] = HEX_CORNERS[None, :, axis] * factors[:, :, others].prod(axis=2) / 8
    return shape, gradients, np.ones(8)


def quadrature(mesh: Mesh) -> Quadrature:
    """The quadrature points of every cell, the points of one cell in sequence.

    Raises:
        MeshError: a cell is folded between its corners.
    """
    _, reference, weights = reference_points(mesh.cell_type)
    x = mesh.vertices[mesh.cells]
    jacobian = np.einsum("mai,paj->mpij", x, reference)
    volumes = np.linalg.det(jacobian) * weights
    folded = (volumes <= 0).any(axis=1)
    if folded.any():
        raise MeshError(f"cell {int(folded.argmax())} is folded between its corners, all of which look right; mend it")
    gradients = np.einsum("paj,mpji->mpai", reference, np.linalg.inv(jacobian))
    points = len(weights)
    nodes = mesh.cells.shape[1]
    return Quadrature(
        nodes=np.ascontiguousarray(np.repeat(mesh.cells, points, axis=0)),
        gradients=np.ascontiguousarray(gradients.reshape(-1, nodes, 3)),
        weights=np.ascontiguousarray(volumes.ravel()),
        cells=np.repeat(np.arange(mesh.n_cells, dtype=np.int32), points),
    )


# A linear tet's mass integrates exactly to ρV (1 + δ_ab)/20; a hex8's to the 2×2×2 sum.
TET_MASS = (np.ones((4, 4)) + np.eye(4)) / 20


def mass_matrix(mesh: Mesh, points: Quadrature, density: Array) -> csr_array:
    """The scalar mass matrix (n, n), kg; M acts on (n, 3) fields column by column.

    Args:
        density: per cell, (m,) float64, kg/m³.
    """
    point_mass = density[points.cells] * points.weights
    if mesh.cell_type == "tet4":
        local = point_mass[:, None, None] * TET_MASS
    else:
        shape = reference_points(mesh.cell_type)[0]
        outer = np.einsum("pa,pb->pab", shape, shape)
        local = (point_mass.reshape(-1, len(outer), 1, 1) * outer).sum(axis=1)
    rows = np.broadcast_to(mesh.cells[:, :, None], local.shape)
    columns = np.broadcast_to(mesh.cells[:, None, :], local.shape)
    n = mesh.n_vertices
    return coo_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsr()
