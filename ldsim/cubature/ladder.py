"""Sets of cubature points: a smaller quadrature rule, on the mesh or virtual, and the best one found of each size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.candidates import Candidates
from ldsim.cubature.rows import Rows
from ldsim.cubature.strain_maps import strain_maps
from ldsim.errors import SolverError
from ldsim.mechanics.scene import Scene

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Progress = Callable[[int, float], None]

POINTS_AT_ONCE = 512


@dataclass(frozen=True, eq=False)
class CubatureSet:
    """A smaller quadrature rule.

    Attributes:
        points: quadrature points of the scene, ascending, (c,) int64.
        weights: their weights, (c,) float64, m³, positive; they replace the scene's.
        training_error: ‖Σ w b − target‖ / ‖target‖ over the normalised poses of the fit.
        maps: ∂F/∂q of virtual points, (c, 9, k) float64, 1/m; None for points of the mesh. A virtual point has the
            material of its point of the mesh, but a deformation gradient of its own (`virtual`).

    Raises:
        SolverError: on shapes that differ, a point given twice, a weight that is not positive and finite, or maps that
            are not finite.
    """

    points: Indices
    weights: Array
    training_error: float
    maps: Array | None = None

    def __post_init__(self) -> None:
        if self.points.ndim != 1 or self.points.shape != self.weights.shape:
            raise SolverError(
                f"cubature set has points of shape {self.points.shape} and weights of shape {self.weights.shape}; "
                "both must be (c,)"
            )
        if len(np.unique(self.points)) < len(self.points):
            raise SolverError("cubature set has a point twice; give each one weight")
        if not (np.isfinite(self.weights).all() and (self.weights > 0).all()):
            raise SolverError(f"cubature weight is {self.weights.min():g} m³; all must be positive and finite")
        if self.maps is not None and self.maps.shape[:2] != (len(self.points), 9):
            raise SolverError(
                f"cubature set has strain maps of shape {self.maps.shape}; must be ({len(self.points)}, 9, k)"
            )
        if self.maps is not None and not np.isfinite(self.maps).all():
            raise SolverError("cubature set has strain maps that are not finite")

    @classmethod
    def every(cls, scene: Scene) -> CubatureSet:
        """All quadrature points of a scene with their own weights."""
        return cls(np.arange(scene.points.n_points), scene.points.weights, 0.0)

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


@dataclass(frozen=True, eq=False)
class VirtualSelection:
    """Virtual points with their errors on poses kept back from everything, and on perturbed states of these.

    Attributes:
        closure: share of the true poses' forces that they aim at.
        tried: share and judged error of what was tried, (t, 2); the first row, with no share, is the best set on the
            mesh.
    """

    cubature: CubatureSet
    heldout_error: float
    perturbed_error: float
    closure: float
    tried: Array

    @property
    def worse_than_mesh(self) -> bool:
        """Whether the best set on the mesh was judged better by more than a tenth."""
        return bool(np.nanmin(self.tried[1:, 1], initial=np.inf) > 1.1 * self.tried[0, 1])


@dataclass(frozen=True)
class CubatureFit:
    """What a fit found.

    Attributes:
        ladder: sets of growing size and falling error, the last of which is `best`.
        best: the smallest set found that meets the tolerance, or else the one of least error.
        met: whether `best` meets the tolerance.
    """

    ladder: tuple[CubatureSet, ...]
    best: CubatureSet
    met: bool


class Ladder:
    """The best set seen of each size.

    Args:
        progress: told the number of points and the relative error after each change.
    """

    def __init__(self, progress: Progress | None = None) -> None:
        self._sets: dict[int, CubatureSet] = {}
        self._progress = progress

    def record(self, state: Candidates) -> None:
        error = state.error
        known = self._sets.get(state.size)
        if state.size and (known is None or error < known.training_error):
            order = np.argsort(state.chosen)
            points = state.chosen[order]
            weights = state.multipliers[order] * state.system.forces.point_weights[points]
            self._sets[state.size] = CubatureSet(points, weights, error)
        if self._progress is not None:
            self._progress(state.size, error)

    def result(self, tolerance: float) -> CubatureFit:
        """Sizes upwards, leaving out what is no better than a smaller set, to the first that meets the tolerance."""
        rungs: list[CubatureSet] = []
        for _, candidate in sorted(self._sets.items()):
            if rungs and candidate.training_error >= rungs[-1].training_error:
                continue
            rungs.append(candidate)
            if candidate.training_error <= tolerance:
                break
        return CubatureFit(tuple(rungs), rungs[-1], rungs[-1].training_error <= tolerance)


def relative_errors(forces: Rows, sets: Sequence[CubatureSet]) -> Array:
    """‖Σ w b − target‖ / ‖target‖ of each set over the normalised poses of `forces`, trained on or not, (l,).

    Raises:
        SolverError: a set has points that the scene does not have.
    """
    errors: Array = np.linalg.norm(residuals(forces, sets), axis=0) / np.linalg.norm(forces.target)
    return errors


def residuals(forces: Rows, sets: Sequence[CubatureSet]) -> Array:
    """target − Σ w b of each set, (rows, l) float64.

    Raises:
        SolverError: a set has points that the scene does not have.
    """
    points = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(entry.points for entry in sets)]))
    if len(points) and not (points[0] >= 0 and points[-1] < forces.n_points):
        raise SolverError(
            f"cubature set has points {points[0]} … {points[-1]}, the scene has {forces.n_points}; use the scene "
            "it was fitted on"
        )
    multipliers = np.zeros((len(points), len(sets)))
    for i, entry in enumerate(sets):
        multipliers[np.searchsorted(points, entry.points), i] = entry.weights / forces.point_weights[entry.points]
    left = np.repeat(forces.target[:, None], len(sets), axis=1)
    for first in range(0, len(points), POINTS_AT_ONCE):
        chunk = slice(first, first + POINTS_AT_ONCE)
        left -= forces.columns(points[chunk]) @ multipliers[chunk]
    return left


def relative_error(forces: Rows, cubature: CubatureSet) -> float:
    """`relative_errors` of one set."""
    return float(relative_errors(forces, [cubature])[0])
