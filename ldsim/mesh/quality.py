"""How well shaped tets are."""

from __future__ import annotations

import numpy as np

from ldsim.arrays import Array
from ldsim.errors import MeshError
from ldsim.mesh.mesh import Mesh, corner_volumes


def radius_ratios(mesh: Mesh) -> Array:
    """Three times the inscribed by the circumscribed sphere's radius, (m,): 1 for a regular tet, 0 for a flat one.

    With edges a, b, c from one corner, volume V and surface S: r = 3V/S, and R = |a²(b×c) + b²(c×a) + c²(a×b)| / 12V.

    Raises:
        MeshError: the cells are no tets.
    """
    if mesh.cell_type != "tet4":
        raise MeshError(f"cells are {mesh.cell_type}; radius ratios are those of tet4")
    volume = np.abs(corner_volumes(mesh)[:, 0])
    x = mesh.vertices[mesh.cells]
    a, b, c = np.moveaxis(x[:, 1:] - x[:, :1], 1, 0)
    normals = np.stack([np.cross(a, b), np.cross(b, c), np.cross(c, a), np.cross(b - a, c - a)])
    surface = np.linalg.norm(normals, axis=2).sum(axis=0) / 2
    aa, bb, cc = ((edge * edge).sum(axis=1)[:, None] for edge in (a, b, c))
    apex = np.linalg.norm(aa * np.cross(b, c) + bb * np.cross(c, a) + cc * np.cross(a, b), axis=1)
    ratios: Array = np.divide(108 * volume**2, surface * apex, out=np.zeros_like(apex), where=apex > 0)
    return ratios
