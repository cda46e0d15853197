"""Dead loads: forces on the solid that keep their size and direction however it deforms."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldsim.errors import SceneError
from ldsim.mechanics.mass import mass_matrix
from ldsim.mechanics.options import LoadOptions
from ldsim.mechanics.quadrature import Quadrature, quadrature
from ldsim.mechanics.regions import Region
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.surface import boundary_faces

Array = NDArray[np.float64]

GAUSS = 1 / np.sqrt(3)


def load_force(mesh: Mesh, density: Array, options: LoadOptions) -> Array:
    """The force of a load on each vertex, (n, 3) float64, N; density of each cell, (m,) kg/m³.

    Raises:
        SceneError: its region holds no cell, or no boundary face.
    """
    if options.acceleration is not None:
        return body_force(mesh, quadrature(mesh), density, options.where, options.acceleration)
    if options.traction is not None:
        return surface_force(mesh, options.where, options.traction)
    assert options.pressure is not None
    return pressure_force(mesh, options.where, options.pressure)


def body_force(mesh: Mesh, points: Quadrature, density: Array, region: Region, acceleration: ArrayLike) -> Array:
    """∫ ρ N_a b dX over the cells of a region, (n, 3) float64, N.

    Args:
        density: of each cell, (m,) kg/m³.
        acceleration: b, (3,) m/s².

    Raises:
        SceneError: the region holds no cell.
    """
    inside = np.where(region.cells_in(mesh, "loads"), density, 0.0)
    force: Array = mass_matrix(mesh, points, inside).sum(axis=1)[:, None] * np.asarray(acceleration)
    return force


def surface_force(mesh: Mesh, region: Region, traction: ArrayLike) -> Array:
    """∫ N_a t dA over the boundary faces whose vertices all lie in a region, (n, 3) float64, N.

    Args:
        traction: t, force per area at rest, (3,) Pa.

    Raises:
        SceneError: the region holds no boundary face.
    """
    faces, areas = _face_areas(mesh, region)
    force = np.linalg.norm(areas, axis=3)[..., None] * np.asarray(traction)
    return _gathered(mesh, faces, force)


def pressure_force(mesh: Mesh, region: Region, pressure: float) -> Array:
    """−∫ N_a p n dA over the same faces with their outward normal n at rest, (n, 3) float64, N; p in Pa."""
    faces, areas = _face_areas(mesh, region)
    return _gathered(mesh, faces, -pressure * areas)


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


def _gathered(mesh: Mesh, faces: NDArray[np.int32], force: Array) -> Array:
    """Sums the forces of face corners, (f, a, p, 3), at the vertices, (n, 3)."""
    total = np.zeros((mesh.n_vertices, 3))
    np.add.at(total, faces, force.sum(axis=2))
    return total
