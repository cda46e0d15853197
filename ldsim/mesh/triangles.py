"""A triangle surface that is to be filled with tets: what it encloses, and whether a point lies inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ldsim.arrays import Array, Indices
from ldsim.mesh.mesh import check_indices


@dataclass(frozen=True, eq=False)
class Triangles:
    """A triangle surface, as clean or as dirty as its file.

    Attributes:
        vertices: (n, 3) float64, metres.
        faces: vertex indices, (f, 3) int64, counter-clockwise seen from outside where the surface is oriented.

    Raises:
        MeshError: on a wrong shape, a coordinate that is not finite, or an index out of range.
    """

    vertices: Array
    faces: Indices

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        faces = np.ascontiguousarray(self.faces, dtype=np.int64)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        check_indices(vertices, faces, 3, "triangle", "f")

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal, metres."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @property
    def volume(self) -> float:
        """Enclosed volume, m³, negative where the triangles look inward; what is enclosed twice counts twice."""
        return float(face_volumes(self).sum())


def face_volumes(surface: Triangles) -> Array:
    """Signed volume between each triangle and the centre of the bounding box, (f,) m³; they add up to the volume."""
    centre = (surface.vertices.min(axis=0) + surface.vertices.max(axis=0)) / 2
    a, b, c = np.moveaxis(surface.vertices[surface.faces] - centre, 1, 0)
    volumes: Array = np.einsum("ti,ti->t", a, np.cross(b, c)) / 6
    return volumes


def winding_number(surface: Triangles, point: ArrayLike) -> float:
    """How often a closed surface winds around a point: 1 inside, 0 outside, −1 inside one that looks inward.

    The sum of the triangles' solid angles over 4π (van Oosterom and Strackee 1983, "The solid angle of a plane
    triangle", Eq. 8).
    """
    a, b, c = np.moveaxis(surface.vertices[surface.faces] - np.asarray(point, dtype=np.float64), 1, 0)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    ab, bc, ca = (np.einsum("ti,ti->t", first, second) for first, second in ((a, b), (b, c), (c, a)))
    triple = np.einsum("ti,ti->t", a, np.cross(b, c))
    return float(np.arctan2(triple, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (2 * np.pi))
