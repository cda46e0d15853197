"""Regions of a solid at rest: where it is pinned, of another material, or loaded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.errors import SceneError
from ldsim.options import Field, Options, Positive, Vector, exactly_one, model_validator

if TYPE_CHECKING:  # whoever only reads a configuration needs no mesh
    from ldsim.mesh.mesh import Group, Mesh

AXES = {"x": 0, "y": 1, "z": 2}
# What rounding may put beyond a bound, a share of the solid's diagonal: 18 mm are 0.018000000000000002 m.
ROUNDING = 1e-9

Mask = NDArray[np.bool_]
Points = Array


class Slab(Options):
    """What lies within a distance of one end of the solid."""

    axis: Annotated[Literal["x", "y", "z"], Field(description="Axis across the slab.")]
    at: Annotated[Literal["min", "max"], Field(description="Which end of the solid.")] = "min"
    thickness: Annotated[Positive, Field(description="How far it reaches inwards from that end, m.")]

    def holds(self, points: Points, mesh: Mesh) -> Mask:
        """Whether each point, (p, 3) metres, lies in it; (p,) bool."""
        x, ends = points[:, AXES[self.axis]], mesh.vertices[:, AXES[self.axis]]
        depth, most = ends.max() - x if self.at == "max" else x - ends.min(), self.thickness + _slack(mesh)
        inside: Mask = depth <= most
        return inside


class Ball(Options):
    """What lies within a distance of a point."""

    centre: Annotated[Vector, Field(description="Centre of the ball, m.")]
    radius: Annotated[Positive, Field(description="Radius of the ball, m.")]

    def holds(self, points: Points, mesh: Mesh) -> Mask:
        """As `Slab.holds`."""
        inside: Mask = np.linalg.norm(points - np.array(self.centre), axis=1) <= self.radius + _slack(mesh)
        return inside


class Box(Options):
    """What lies between two corners; the edges go along the axes."""

    min: Annotated[Vector, Field(description="Its corner of smallest coordinates, m.")]
    max: Annotated[Vector, Field(description="Its corner of largest coordinates, m.")]

    @model_validator(mode="after")
    def _ordered(self) -> Box:
        if any(low > high for low, high in zip(self.min, self.max, strict=True)):
            raise ValueError(f"min {list(self.min)} must not be greater than max {list(self.max)} on any axis")
        return self

    def holds(self, points: Points, mesh: Mesh) -> Mask:
        """As `Slab.holds`."""
        low, high = np.array(self.min) - _slack(mesh), np.array(self.max) + _slack(mesh)
        inside: Mask = np.all((points >= low) & (points <= high), axis=1)
        return inside


class Region(Options):
    """A part of the solid at rest: in a slab, a ball or a box, or vertices of a list or of a group.

    A cell belongs to a slab, a ball or a box if its centroid does, and to a list if all its vertices do.
    """

    slab: Annotated[Slab | None, Field(description="One end of the solid.")] = None
    ball: Annotated[Ball | None, Field(description="What lies in a ball.")] = None
    box: Annotated[Box | None, Field(description="What lies in a box with edges along the axes.")] = None
    vertices: Annotated[
        tuple[Annotated[int, Field(ge=0)], ...] | None,
        Field(min_length=1, description="These vertices, numbered from 0 as in scene.h5."),
    ] = None
    group: Annotated[
        str | None, Field(description="A group of the mesh file; `ldsim info` of scene.h5 lists them.")
    ] = None

    _one = exactly_one("slab", "ball", "box", "vertices", "group")

    def __str__(self) -> str:
        kind, value = next((name, value) for name, value in self if value is not None)
        words = ", ".join(f"{name} {entry}" for name, entry in value) if isinstance(value, Options) else repr(value)
        return f"the {kind} ({words})"

    def vertices_in(self, mesh: Mesh, use: str) -> Mask:
        """Whether each vertex belongs to it, (n,) bool, of which some must.

        Args:
            use: what for, as the message's verb: "pins", "moves".

        Raises:
            SceneError: none does, or the mesh lacks a vertex of the list or the group.
        """
        return self._some(self.vertex_mask(mesh), f"{use} no vertex", mesh)

    def cells_in(self, mesh: Mesh, use: str) -> Mask:
        """Whether each cell belongs to it, (m,) bool; see `vertices_in`."""
        return self._some(self.cell_mask(mesh), f"{use} no cell", mesh)

    def vertex_mask(self, mesh: Mesh) -> Mask:
        """As `vertices_in`, but there may be none."""
        volume = self._volume
        if volume is not None:
            return volume.holds(mesh.vertices, mesh)
        if self.group is not None:
            return _mask(self._group(mesh).vertices, mesh.n_vertices)
        numbers = np.array(self.vertices)
        if numbers.max() >= mesh.n_vertices:
            wrong = numbers[numbers >= mesh.n_vertices][0]
            raise SceneError(f"vertex {wrong} of a list does not exist; the mesh has 0 … {mesh.n_vertices - 1}")
        return _mask(numbers, mesh.n_vertices)

    def cell_mask(self, mesh: Mesh) -> Mask:
        """As `cells_in`, but there may be none."""
        volume = self._volume
        if volume is not None:
            return volume.holds(mesh.vertices[mesh.cells].mean(axis=1), mesh)
        if self.group is not None:
            return _mask(self._group(mesh).cells, mesh.n_cells)
        whole: Mask = np.all(self.vertex_mask(mesh)[mesh.cells], axis=1)
        return whole

    @property
    def _volume(self) -> Slab | Ball | Box | None:
        return self.slab or self.ball or self.box

    def _group(self, mesh: Mesh) -> Group:
        assert self.group is not None
        if self.group not in mesh.groups:
            known = ", ".join(sorted(mesh.groups)) or "none: its file defines no groups"
            raise SceneError(f"the mesh has no group {self.group!r}; known are {known}")
        return mesh.groups[self.group]

    def _some(self, found: Mask, nothing: str, mesh: Mesh) -> Mask:
        if not found.any():
            low, high = (end(mesh.vertices, axis=0).round(4).tolist() for end in (np.min, np.max))
            raise SceneError(f"{self} {nothing}; the solid spans {low} … {high} m")
        return found


def _slack(mesh: Mesh) -> float:
    return ROUNDING * mesh.diagonal


def _mask(indices: Indices, size: int) -> Mask:
    mask = np.zeros(size, dtype=bool)
    mask[indices] = True
    return mask
