"""The scene: everything physical, once — mesh, material per cell, density, pins, gravity and time step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ldsim.arrays import Array, Indices
from ldsim.errors import SceneError
from ldsim.mechanics.elastic import Elements
from ldsim.mechanics.materials import material_names, material_number
from ldsim.mechanics.properties import Properties, lame_parameters
from ldsim.mechanics.quadrature import Quadrature, mass_matrix, quadrature
from ldsim.mesh.mesh import Mesh, check_cells, components, doubled_vertices, doubled_words

# Their resistance to a change of volume is λ alone; below that the solid grows without bound, or as it likes.
RESISTS_VOLUME = {"neo_hookean": np.greater, "fixed_corotated": np.greater_equal}


@dataclass(frozen=True, eq=False)
class Scene:
    """A solid with its material, supports and loads.

    Attributes:
        mesh: the volume mesh.
        material: number of the material of each cell, (m,) int8 (`mechanics.materials.MATERIALS`).
        mu, lam: Lamé parameters of each cell, (m,) float64, Pa.
        density: of each cell, (m,) float64, kg/m³.
        pinned: true for vertices that do not move, (n,) bool.
        gravity: acceleration, (3,) float64, m/s².
        time_step: h, s.
        load: dead load on each vertex besides its weight, (n, 3) float64, N; None where there is none.

    Raises:
        SceneError: on a material that does not exist, on a modulus, density, force or time step that is not allowed, a
            part without a pin, or when nothing is free to move.
        MeshError: on inverted, degenerate or repeated cells.
    """

    mesh: Mesh
    material: NDArray[np.int8]
    mu: Array
    lam: Array
    density: Array
    pinned: NDArray[np.bool_]
    gravity: Array
    time_step: float
    load: Array | None = None

    def __post_init__(self) -> None:
        n, m = self.mesh.n_vertices, self.mesh.n_cells
        load = np.zeros((n, 3)) if self.load is None else self.load
        expected = (m, m, m, m, n, 3, 3 * n)
        given = (self.material, self.mu, self.lam, self.density, self.pinned, self.gravity, load)
        if tuple(np.size(values) for values in given) != expected or load.shape != (n, 3):
            found = [np.shape(values) for values in given]
            raise SceneError(
                f"material, mu, lam, density, pinned, gravity, load have shapes {found}; the mesh {n}, {m}"
            )
        if self.pinned.dtype != np.bool_:
            raise SceneError(f"pinned is of type {self.pinned.dtype}; expected bool, true where vertices stand still")
        material_names(np.unique(self.material).tolist())
        for name, values in (("mu", self.mu), ("bulk modulus", self.lam + 2 / 3 * self.mu), ("density", self.density)):
            if not (np.isfinite(values).all() and (values > 0).all()):
                raise SceneError(f"{name} of a cell is {values.min():g}; it must be positive and finite")
        for name, allowed in RESISTS_VOLUME.items():
            wrong = (self.material == material_number(name)) & ~allowed(self.lam, 0)
            if wrong.any():
                cell = int(wrong.argmax())
                ratio = self.lam[cell] / (2 * (self.lam[cell] + self.mu[cell]))
                raise SceneError(
                    f"cell {cell} is of {name} with Poisson's ratio {ratio:.3g}, where a change of volume "
                    "costs nothing or less; give a greater one, or use stable_neo_hookean"
                )
        for name, values in (("gravity", self.gravity), ("load", load)):
            if not np.isfinite(values).all():
                raise SceneError(f"{name} holds {values[~np.isfinite(values)][0]:g}; it must be finite")
        if not 0 < self.time_step < np.inf:
            raise SceneError(f"time step is {self.time_step:g} s; it must be positive and finite")
        if self.pinned.all():
            raise SceneError(f"the pins hold all {n} vertices; at least one must be free to move")
        check_cells(self.mesh)
        labels = components(self.mesh)
        supported = np.unique(labels[self.pinned])
        loose = np.setdiff1d(np.unique(labels), supported)
        if len(loose):
            sizes, doubled = np.bincount(labels), doubled_vertices(self.mesh)
            raise SceneError(
                f"{len(loose)} of {len(sizes)} connected parts have no pinned vertex, the first with {sizes[loose[0]]} "
                "vertices; pin a part of each (mesh.pins) or remove it"
                + (f"; {doubled_words(doubled)}" if doubled else "")
            )

    @cached_property
    def points(self) -> Quadrature:
        return quadrature(self.mesh)

    @cached_property
    def elements(self) -> Elements:
        """Quadrature points with their material, as the kernels read them."""
        cell = self.points.cells
        return Elements(
            self.points.nodes,
            self.points.gradients,
            self.points.weights,
            self.material[cell],
            self.mu[cell],
            self.lam[cell],
        )

    @cached_property
    def mass(self) -> csr_array:
        """Scalar consistent mass matrix, (n, n), kg."""
        return mass_matrix(self.mesh, self.points, self.density)

    @cached_property
    def vertex_mass(self) -> Array:
        """Row sums of the mass matrix, (n,) float64, kg; zero where pinned."""
        return np.where(self.pinned, 0.0, self.mass.sum(axis=1))

    @cached_property
    def external_force(self) -> Array:
        """Weight and load of each vertex under the scene's own gravity, (n, 3) float64, N; zero where pinned."""
        return self.force(self.gravity)

    def force(self, gravity: Array) -> Array:
        """The same under another gravity, (3,) m/s²."""
        weight: Array = self.vertex_mass[:, None] * gravity
        return weight if self.load is None else weight + np.where(self.pinned[:, None], 0.0, self.load)

    @cached_property
    def movable(self) -> NDArray[np.bool_]:
        return ~self.pinned

    def stiffened(self, scale: float) -> Scene:
        """The same solid with its Lamé parameters times a positive number."""
        scene = replace(self, mu=scale * self.mu, lam=scale * self.lam)
        scene.__dict__.update(points=self.points, mass=self.mass)  # cached, and the same
        return scene

    @property
    def free(self) -> Indices:
        """The vertices that move, (f,) int64."""
        return np.flatnonzero(~self.pinned)


def make_scene(
    mesh: Mesh,
    pinned: NDArray[np.bool_],
    properties: Properties,
    gravity: tuple[float, float, float],
    time_step: float,
    load: Array | None = None,
) -> Scene:
    """A scene of given material properties; gravity in m/s², time step in s, load (n, 3) in N."""
    mu, lam = lame_parameters(properties.youngs_modulus, properties.poisson_ratio)
    g = np.array(gravity, dtype=np.float64)
    return Scene(mesh, properties.kind, mu, lam, properties.density, pinned, g, time_step, load)


def with_properties(scene: Scene, properties: Properties) -> Scene:
    """The same scene of another material; its density stays, and with it the mass."""
    mu, lam = lame_parameters(properties.youngs_modulus, properties.poisson_ratio)
    return replace(scene, material=properties.kind, mu=mu, lam=lam)


def properties_of(scene: Scene) -> Properties:
    """The material properties of a scene: E = μ (3λ + 2μ) / (λ + μ), ν = λ / 2(λ + μ)."""
    mu, lam = scene.mu, scene.lam
    modulus, ratio = mu * (3 * lam + 2 * mu) / (lam + mu), lam / (2 * (lam + mu))
    return Properties(scene.material, modulus, ratio, scene.density)
