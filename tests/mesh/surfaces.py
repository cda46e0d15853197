"""Triangle surfaces, clean and dirty, for tests."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import ArrayLike

from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import CUBE_CORNERS, SHAPES
from ldsim.mesh.surface import surface_triangles
from ldsim.mesh.triangles import Triangles


def surface_of(shape: str, resolution: int = 1) -> Triangles:
    """The surface of a procedural shape."""
    return boundary(SHAPES[shape](resolution=resolution))


def box(sides: ArrayLike, offset: ArrayLike = 0.0) -> Triangles:
    """Twelve triangles."""
    corners = CUBE_CORNERS * np.asarray(sides, dtype=float) + np.asarray(offset, dtype=float)
    return boundary(Mesh(corners, np.arange(8, dtype=np.int32)[None], "hex8"))


def boundary(mesh: Mesh) -> Triangles:
    faces = surface_triangles(mesh)
    used, index = np.unique(faces, return_inverse=True)
    return Triangles(mesh.vertices[used], index.reshape(faces.shape))


def together(*surfaces: Triangles) -> Triangles:
    """Several surfaces as one, sharing no vertex."""
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    faces = [surface.faces + start for surface, start in zip(surfaces, starts, strict=False)]
    return Triangles(np.concatenate([surface.vertices for surface in surfaces]), np.concatenate(faces))


def turned_over(surface: Triangles) -> Triangles:
    return Triangles(surface.vertices, surface.faces[:, ::-1])


def soup(surface: Triangles) -> Triangles:
    """Three vertices of its own for each triangle, as in an STL file."""
    return Triangles(surface.vertices[surface.faces].reshape(-1, 3), np.arange(3 * len(surface.faces)).reshape(-1, 3))


def is_closed_and_oriented(surface: Triangles) -> bool:
    """Each edge once in either direction."""
    edges = Counter(map(tuple, surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()))
    return set(edges.values()) == {1} and all((b, a) in edges for a, b in edges)
