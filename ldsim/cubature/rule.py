"""A cubature rule: a smaller quadrature rule, some points with weights of their own, on the mesh or virtual.

The potential sees a point only by its strain map, the linear dependence of its deformation gradient on the coordinates
of a basis, so a point that lies nowhere on the mesh is as good as one that does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.errors import SolverError
from ldsim.mechanics.elastic import Elements, elements_at
from ldsim.mechanics.scene import Scene


@dataclass(frozen=True, eq=False)
class CubatureRule:
    """A smaller quadrature rule.

    Attributes:
        points: quadrature points of the scene, ascending where stored, (c,) int64.
        weights: their weights, (c,) float64, m³, positive; they replace the scene's.
        training_error: ‖Σ w b − target‖ / ‖target‖ over the normalised poses of the fit.
        maps: ∂F/∂q of virtual points, (c, 9, k) float64, 1/m; None for points of the mesh. A virtual point has the
            material of its point of the mesh, but a deformation gradient of its own (`virtual`).
        material: number of the material that all virtual points have; None for that of their points of the mesh.
        heldout_error, perturbed_error: the same on poses kept back from the fit, and on perturbed states of these; NaN
            where it was not measured.

    Raises:
        SolverError: on shapes that differ, a point given twice, a weight that is not positive and finite, or maps that
            are not finite.
    """

    points: Indices
    weights: Array
    training_error: float
    maps: Array | None = None
    heldout_error: float = math.nan
    perturbed_error: float = math.nan
    material: int | None = None

    def __post_init__(self) -> None:
        if self.points.ndim != 1 or self.points.shape != self.weights.shape:
            raise SolverError(
                f"cubature rule has points of shape {self.points.shape} and weights of shape {self.weights.shape}; "
                "both must be (c,)"
            )
        if self.points.min(initial=0) < 0:
            raise SolverError(
                f"cubature rule has the point {self.points.min()}; numbered from 0 in the scene it was fitted on"
            )
        if len(np.unique(self.points)) < len(self.points):
            raise SolverError("cubature rule has a point twice; give each one weight")
        if not (np.isfinite(self.weights).all() and (self.weights > 0).all()):
            raise SolverError(f"cubature weight is {self.weights.min():g} m³; all must be positive and finite")
        if self.maps is not None and self.maps.shape[:2] != (len(self.points), 9):
            raise SolverError(
                f"cubature rule has strain maps of shape {self.maps.shape}; must be ({len(self.points)}, 9, k)"
            )
        if self.maps is not None and not np.isfinite(self.maps).all():
            raise SolverError("cubature rule has strain maps that are not finite")

    @classmethod
    def every(cls, scene: Scene) -> CubatureRule:
        """All quadrature points of a scene with their own weights."""
        return cls(np.arange(scene.points.n_points), scene.points.weights, 0.0)

    def sorted_by(self, kind: NDArray[np.int8]) -> CubatureRule:
        """The same rule with its points in the order of their materials, kind (s,), as a step wants them."""
        order = np.argsort(kind[self.points], kind="stable")
        if self.material is not None or (order == np.arange(len(order))).all():
            return self
        maps = None if self.maps is None else self.maps[order]
        return replace(self, points=self.points[order], weights=np.asarray(self.weights)[order], maps=maps)

    def strain_maps(self, scene: Scene, U: Array) -> Array:
        """∂F/∂q of the points in the space of U, (3n, k): their own, or those of the mesh; (c, 9, k) float64, 1/m.

        Raises:
            SolverError: the maps are of a basis of another size.
        """
        if self.maps is None:
            return strain_maps(scene, U, self.points)
        if self.maps.shape[2] != U.shape[1]:
            raise SolverError(f"cubature has strain maps of {self.maps.shape[2]} columns; the basis has {U.shape[1]}")
        return np.ascontiguousarray(self.maps, dtype=np.float64)

    def elements(self, scene: Scene) -> Elements:
        """The points with their material, as the kernels read them; their weights are the scene's."""
        found = elements_at(scene.elements, self.points)
        return found if self.material is None else found._replace(kind=np.full_like(found.kind, self.material))


def strain_maps(scene: Scene, U: Array, points: Indices) -> Array:
    """∂F/∂q of the given points, (c, 9, k) float64, 1/m: G_s = Σ_a U_a ⊗ ∇N_a, F's nine entries row by row."""
    k = U.shape[1]
    nodal = U.reshape(scene.mesh.n_vertices, 3, k)
    maps = np.empty((len(points), 9, k))
    for start in range(0, len(points), 4096):
        part = points[start : start + 4096]
        maps[start : start + 4096] = np.einsum(
            "saik,saj->sijk", nodal[scene.points.nodes[part]], scene.points.gradients[part], optimize=True
        ).reshape(len(part), 9, k)
    return maps
