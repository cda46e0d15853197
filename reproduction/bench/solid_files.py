"""Ten solids as users have them: files of meshes in metres, and of surfaces in millimetres, as CAD has them.

Eight have 2,000 to 10,000 cells, the last two, an antler and a cushion, more than 20,000. They are made by rule, from
grids of cubes that are bent into shape, so that nothing has to be shipped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.mesh.mesh import Mesh, reoriented
from ldsim.mesh.shapes import voxel_mesh
from ldsim.mesh.surface import surface_triangles

Place = tuple[float, float, float]
Limb = tuple[Place, Place, float]  # from where, to where, and its radius
MESHIO_TYPES = {"tet4": "tetra", "hex8": "hexahedron"}


def write_solid(name: str, folder: Path) -> Path:
    """Write the file of a solid, or of the coarse one of that name, into a folder; returns its path."""
    made = (SOLIDS | COARSE)[name]()
    if isinstance(made, Mesh):
        path, cells = folder / f"{name}.vtu", [(MESHIO_TYPES[made.cell_type], made.cells)]
        content = meshio.Mesh(made.vertices, cells)
    else:
        vertices, triangles = made
        path, content = folder / f"{name}.stl", meshio.Mesh(1e3 * vertices, [("triangle", triangles)])
    folder.mkdir(parents=True, exist_ok=True)
    meshio.write(path, content)
    return path


def slender() -> Mesh:
    """A finger of 250 mm, 16 mm thick at its root and 9 at its tip, bent a little."""
    mesh = _grid((60, 4, 4), (0.25, 1.0, 1.0))
    x, y, z = mesh.vertices.T
    thickness = 0.016 - 0.028 * x
    return _bent(mesh, np.stack([x, thickness * (y - 0.5) + 0.4 * x**2, thickness * (z - 0.5)], axis=1))


def thick() -> Mesh:
    """A cylinder 80 mm wide and 70 mm high."""
    mesh = _grid((10, 8, 10), (2.0, 0.07, 2.0))
    x, y, z = mesh.vertices.T
    disc = 0.04 * _disc(np.stack([x, z], axis=1) - 1.0)
    return _bent(mesh, np.stack([disc[:, 0], y, disc[:, 1]], axis=1))


def branching() -> Mesh:
    """A trunk of 140 mm with three limbs, of cubes."""
    limbs: list[Limb] = [
        ((0, 0, 0), (0, 140, 0), 13),
        ((0, 60, 0), (70, 110, 10), 9),
        ((0, 85, 0), (-60, 135, -20), 9),
        ((0, 100, 0), (10, 150, 60), 8),
    ]
    return _of_limbs(limbs, 5.0, (-80, 0, -40), (90, 165, 80))


def plate() -> Mesh:
    """A plate of 160 × 100 × 6 mm with a hole of 40 × 30 mm."""
    occupied = np.ones((32, 20, 2), dtype=bool)
    occupied[16:24, 7:13] = False
    return voxel_mesh(occupied, [0.005, 0.005, 0.003])


def ring() -> Mesh:
    """An upright ring 130 mm wide, of a square section of 18 mm that is twisted once around."""
    around, across = 44, 4
    mesh = _grid((around, across, across), (around, 1.0, 1.0))
    angle, (u, v) = 2 * np.pi * mesh.vertices[:, 0] / around, 0.018 * (mesh.vertices[:, 1:].T - 0.5)
    u, v = np.cos(angle) * u - np.sin(angle) * v, np.sin(angle) * u + np.cos(angle) * v
    radius = 0.056 + u
    points = np.stack([radius * np.sin(angle), -radius * np.cos(angle), v], axis=1)
    first, last = mesh.vertices[:, 0] == 0, mesh.vertices[:, 0] == around
    number = np.arange(len(points))
    number[last] = number[first]
    used, cells = np.unique(number[mesh.cells], return_inverse=True)
    return _bent(Mesh(mesh.vertices[used], cells.reshape(-1, 4).astype(np.int32), "tet4"), points[used])


def bracket() -> tuple[Array, NDArray[np.int32]]:
    """The surface of an angle bracket of 120 × 80 × 60 mm, 12 mm thick, with a rib and a hole."""
    x, y, z = np.indices((20, 14, 10))  # of 6 mm
    occupied = (y < 2) | (x < 2)
    occupied |= (np.abs(z - 4.5) < 1) & (x + 1.4 * y < 14)
    occupied &= ~((y < 2) & (x >= 13) & (x < 16) & (z >= 3) & (z < 7))
    return _surface(voxel_mesh(occupied, 0.006))


def blob() -> tuple[Array, NDArray[np.int32]]:
    """The surface of a lump of some 110 mm with a flat foot and a neck."""
    mesh = _grid((16, 16, 16), (2.0, 2.0, 2.0))
    cube = mesh.vertices - 1.0
    largest = np.abs(cube).max(axis=1)
    directions = cube / np.maximum(np.linalg.norm(cube, axis=1), 1e-12)[:, None]
    bumps = 1 + 0.25 * np.sin(3 * directions[:, 0] + 1) * np.cos(2 * directions[:, 2]) + 0.2 * directions[:, 1] ** 3
    points = 0.05 * (largest * bumps)[:, None] * directions
    points[:, 1] = np.maximum(points[:, 1], -0.035)
    vertices, triangles = _surface(_bent(mesh, points))
    return vertices, triangles


def hexes() -> Mesh:
    """A bar of 180 × 40 × 30 mm of hexahedra, twisted by a quarter."""
    occupied = np.ones((36, 8, 7), dtype=bool)
    mesh = voxel_mesh(occupied, [0.005, 0.005, 0.03 / 7], "hex8")
    x, y, z = mesh.vertices.T
    turn = 0.5 * np.pi * x / 0.18
    y, z = y - 0.02, z - 0.015
    return _bent(mesh, np.stack([x, np.cos(turn) * y - np.sin(turn) * z, np.sin(turn) * y + np.cos(turn) * z], axis=1))


def antler(spacing: float = 3.5) -> Mesh:
    """A slender branch of 300 mm with five tines, of cubes of so many millimetres."""
    limbs: list[Limb] = [
        ((0, 0, 0), (10, 150, 0), 10),
        ((10, 150, 0), (-30, 300, 20), 8),
        ((5, 80, 0), (90, 150, 30), 7),
        ((10, 140, 0), (100, 230, -20), 7),
        ((-5, 205, 8), (-100, 260, -10), 7),
        ((90, 150, 30), (110, 210, 60), 6),
        ((-15, 245, 12), (20, 290, 80), 6),
    ]
    return _of_limbs(limbs, spacing, (-115, 0, -45), (120, 315, 95))


def cushion(cubes: int = 16) -> Mesh:
    """A pear 120 mm wide and some 100 high, with a flat foot, of so many cubes in each direction."""
    mesh = _grid((cubes, cubes, cubes), (2.0, 2.0, 2.0))
    x, y, z = mesh.vertices.T - 1.0
    disc = _disc(np.stack([x, z], axis=1))
    width = 0.06 * (1 - 0.25 * (y + 1) + 0.1 * np.sin(2 * y))
    return _bent(mesh, np.stack([width * disc[:, 0] + 0.01 * (y + 1) ** 2, 0.05 * y, 0.8 * width * disc[:, 1]], axis=1))


SOLIDS: dict[str, Callable[[], Mesh | tuple[Array, NDArray[np.int32]]]] = {
    made.__name__: made for made in (slender, thick, branching, plate, ring, bracket, blob, hexes, antler, cushion)
}
# The same solids as meshes that are coarse enough to be pulled at in the full space.
COARSE: dict[str, Callable[[], Mesh]] = {
    "antler_coarse": lambda: antler(5.5),
    "cushion_coarse": lambda: cushion(9),
}


def _grid(counts: tuple[int, int, int], size: tuple[float, float, float]) -> Mesh:
    """Tets of a box from the origin on."""
    return voxel_mesh(np.ones(counts, dtype=bool), np.array(size) / counts)


def _bent(mesh: Mesh, vertices: Array) -> Mesh:
    """The same cells, the other way round where bending turned them over."""
    return reoriented(replace(mesh, vertices=np.ascontiguousarray(vertices)))


def _disc(square: Array) -> Array:
    """The square [−1, 1]² as nearly the unit disc, (v, 2): squares around the middle become nearly circles.

    Of a true circle the cells at the corners would be flat.
    """
    largest, length = np.abs(square).max(axis=1), np.linalg.norm(square, axis=1)
    shared: Array = square * (0.2 + 0.8 * largest / np.maximum(length, 1e-12))[:, None]
    return shared


def _of_limbs(limbs: list[Limb], spacing: float, low: Place, high: Place) -> Mesh:
    """Tets of the cubes whose middle is inside a limb; all lengths in millimetres."""
    corner = np.array(low, dtype=float)
    counts = ((np.array(high) - corner) / spacing).astype(int)
    centres = corner + spacing * (np.indices(counts).reshape(3, -1).T + 0.5)
    inside = np.zeros(len(centres), dtype=bool)
    for start, end, radius in limbs:
        inside |= _from_segment(centres, np.array(start, float), np.array(end, float)) <= radius
    mesh = voxel_mesh(inside.reshape(tuple(counts)), 1e-3 * spacing)
    return _bent(mesh, mesh.vertices + 1e-3 * corner)


def _from_segment(points: Array, start: Array, end: Array) -> Array:
    """Distances of points (N, 3) from a segment, (N,)."""
    along = end - start
    share = np.clip((points - start) @ along / (along @ along), 0, 1)
    distance: Array = np.linalg.norm(points - start - share[:, None] * along, axis=1)
    return distance


def _surface(mesh: Mesh) -> tuple[Array, NDArray[np.int32]]:
    """The vertices and triangles of its surface alone."""
    used, triangles = np.unique(surface_triangles(mesh), return_inverse=True)
    return mesh.vertices[used], triangles.reshape(-1, 3).astype(np.int32)
