"""Regions of a solid: where it is pinned, of another material, or loaded."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import SceneError
from ldsim.mesh.mesh import Group, Mesh

AXES = {"x": 0, "y": 1, "z": 2}

Mask = NDArray[np.bool_]


class Region(ABC):
    """A part of the solid at rest."""

    @abstractmethod
    def vertices(self, mesh: Mesh) -> Mask:
        """Whether each vertex lies in it, (n,) bool."""

    @abstractmethod
    def cells(self, mesh: Mesh) -> Mask:
        """Whether each cell belongs to it, (m,) bool."""


class Volume(Region):
    """A part of space; a cell belongs to it if its centroid does."""

    @abstractmethod
    def holds(self, points: NDArray[np.float64], mesh: Mesh) -> Mask:
        """Whether each point, (p, 3) metres, lies in it; (p,) bool."""

    def vertices(self, mesh: Mesh) -> Mask:
        return self.holds(mesh.vertices, mesh)

    def cells(self, mesh: Mesh) -> Mask:
        return self.holds(mesh.vertices[mesh.cells].mean(axis=1), mesh)


@dataclass(frozen=True)
class Slab(Volume):
    """What lies within `thickness` metres of the solid's smallest (or largest) coordinate on an axis."""

    axis: str
    at_max: bool
    thickness: float

    def holds(self, points: NDArray[np.float64], mesh: Mesh) -> Mask:
        x, ends = points[:, AXES[self.axis]], mesh.vertices[:, AXES[self.axis]]
        inside: Mask = x >= ends.max() - self.thickness if self.at_max else x <= ends.min() + self.thickness
        return inside


@dataclass(frozen=True)
class Ball(Volume):
    """What lies within `radius` metres of `centre`."""

    centre: tuple[float, float, float]
    radius: float

    def holds(self, points: NDArray[np.float64], mesh: Mesh) -> Mask:
        inside: Mask = np.linalg.norm(points - np.array(self.centre), axis=1) <= self.radius
        return inside


@dataclass(frozen=True)
class Box(Volume):
    """What lies in the box with edges along the axes between two corners, metres."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def holds(self, points: NDArray[np.float64], mesh: Mesh) -> Mask:
        inside: Mask = np.all((points >= np.array(self.low)) & (points <= np.array(self.high)), axis=1)
        return inside


@dataclass(frozen=True)
class VertexList(Region):
    """The vertices of a list; a cell belongs to it if all its vertices do.

    Raises (when asked):
        SceneError: a vertex that the mesh does not have.
    """

    numbers: tuple[int, ...]

    def vertices(self, mesh: Mesh) -> Mask:
        wrong = [number for number in self.numbers if not 0 <= number < mesh.n_vertices]
        if wrong:
            raise SceneError(f"vertex {wrong[0]} of a list does not exist; the mesh has 0 … {mesh.n_vertices - 1}")
        return _mask(np.array(self.numbers), mesh.n_vertices)

    def cells(self, mesh: Mesh) -> Mask:
        whole: Mask = np.all(self.vertices(mesh)[mesh.cells], axis=1)
        return whole


@dataclass(frozen=True)
class NamedGroup(Region):
    """A group that the mesh file defines.

    Raises (when asked):
        SceneError: the mesh has no such group; the message names those it has.
    """

    name: str

    def vertices(self, mesh: Mesh) -> Mask:
        return _mask(self._find(mesh).vertices, mesh.n_vertices)

    def cells(self, mesh: Mesh) -> Mask:
        return _mask(self._find(mesh).cells, mesh.n_cells)

    def _find(self, mesh: Mesh) -> Group:
        if self.name not in mesh.groups:
            known = ", ".join(sorted(mesh.groups)) or "none: its file defines no groups"
            raise SceneError(f"the mesh has no group {self.name!r}; known are {known}")
        return mesh.groups[self.name]


def _mask(indices: NDArray[np.int64], size: int) -> Mask:
    mask = np.zeros(size, dtype=bool)
    mask[indices] = True
    return mask


def vertices_in(region: Region, mesh: Mesh, use: str) -> Mask:
    """The vertices of a region, (n,) bool, of which there must be some.

    Args:
        use: what for, as the message's verb: "pins", "moves".

    Raises:
        SceneError: there are none.
    """
    found = region.vertices(mesh)
    if not found.any():
        raise SceneError(f"{region} {use} no vertex; {_extent(mesh)}")
    return found


def cells_in(region: Region, mesh: Mesh, use: str) -> Mask:
    """The cells of a region, (m,) bool, of which there must be some; see `vertices_in`."""
    found = region.cells(mesh)
    if not found.any():
        raise SceneError(f"{region} {use} no cell; {_extent(mesh)}")
    return found


def _extent(mesh: Mesh) -> str:
    low, high = mesh.vertices.min(axis=0).round(4).tolist(), mesh.vertices.max(axis=0).round(4).tolist()
    return f"the solid spans {low} … {high} m"
