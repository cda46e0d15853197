"""Dead loads: forces on the solid that keep their size and direction however it deforms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.errors import SceneError
from ldsim.mechanics.options import LoadOptions
from ldsim.mechanics.quadrature import GAUSS, mass_matrix, quadrature
from ldsim.mechanics.regions import Region
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.surface import boundary_faces


def load_force(mesh: Mesh, density: Array, options: LoadOptions) -> Array:
    """The force of a load on each vertex, (n, 3) float64, N; density of each cell, (m,) kg/m³.

    For an acceleration b ∫ ρ N_a b dX over the cells of its region; over boundary faces whose vertices all lie in it
    ∫ N_a t dA for a traction t, and −∫ N_a p n dA for a pressure p, with the outward normal n at rest.

    Raises:
        SceneError: its region holds no cell, or no boundary face.
    """
    if options.acceleration is not None:
        inside = np.where(options.where.cells_in(mesh, "loads"), density, 0.0)
        mass = mass_matrix(mesh, quadrature(mesh), inside).sum(axis=1)[:, None]
        weight: Array = mass * np.array(options.acceleration)
        return weight
    faces, areas = _face_areas(mesh, options.where)
    if options.traction is not None:
        force = np.linalg.norm(areas, axis=3)[..., None] * np.array(options.traction)
    else:
        assert options.pressure is not None
        force = -options.pressure * areas
    total = np.zeros((mesh.n_vertices, 3))
    np.add.at(total, faces, force.sum(axis=2))
    return total


def _face_areas(mesh: Mesh, region: Region) -> tuple[NDArray[np.int32], Array]:
    """The boundary faces of a region, (f, a), and n dA at their quadrature points, (f, a, p, 3), m², times N_a."""
    faces = boundary_faces(mesh)
    faces = faces[region.vertex_mask(mesh)[faces].all(axis=1)]
    if len(faces) == 0:
        raise SceneError(f"{region} holds no face of the surface; a face is loaded if all its vertices lie within")
    x = mesh.vertices[faces]
    if faces.shape[1] == 3:
        normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]) / 2
        return faces, np.broadcast_to(normal[:, None, None] / 3, (len(faces), 3, 1, 3))
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
    factors = 1 + GAUSS * corners[:, None] * corners
    shape = factors.prod(axis=2) / 4
    along = np.einsum("pa,fai->fpi", corners[:, 0] * factors[:, :, 1] / 4, x)
    across = np.einsum("pa,fai->fpi", corners[:, 1] * factors[:, :, 0] / 4, x)
    return faces, np.einsum("pa,fpi->fapi", shape, np.cross(along, across))
