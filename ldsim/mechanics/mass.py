"""Consistent mass matrix, M_ab = ∫ ρ N_a N_b dX, the same for each axis."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from ldsim.arrays import Array
from ldsim.mechanics.quadrature import Quadrature, reference_points
from ldsim.mesh.mesh import Mesh

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
