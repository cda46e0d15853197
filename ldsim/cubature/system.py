"""The least-squares system of cubature: forces and volume as one, and the few of its columns at work in one round."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.cubature.nnls import losses_without, nnls, solve_on_support
from ldsim.cubature.terms import Term


@dataclass(frozen=True, eq=False)
class System:
    """The forces, and one more equation, which asks that the weights sum to the volume.

    For multipliers x_s it reads Σ_s v ‖target‖ x_s w_s / Σ w = v ‖target‖: without it, few points that fit the forces
    may weigh much less than the solid, and be soft in every direction that the poses do not show.

    Attributes:
        forces: their error is the one that a tolerance is for.
        volume: v, the weight of the volume; 0 leaves it out.
        candidates: the points that may be chosen, (c,); None for all.
    """

    forces: Term
    volume: float
    candidates: Indices | None = None

    @property
    def n_points(self) -> int:
        """All points of the scene, s."""
        return len(self.forces.point_weights)

    @cached_property
    def allowed(self) -> Indices:
        """The points that may be chosen, (c,)."""
        return np.arange(self.n_points) if self.candidates is None else self.candidates

    @cached_property
    def force_norm(self) -> float:
        """‖target‖ of the forces."""
        return float(np.linalg.norm(self.forces.target))

    @cached_property
    def volume_shares(self) -> Array:
        """What each point adds to the equation of the volume with its full weight, (s,)."""
        weights = self.forces.point_weights
        shares: Array = self.volume * self.force_norm * weights / weights.sum()
        return shares

    @cached_property
    def target(self) -> Array:
        """The forces' target and that of the volume, (e,) float64."""
        return np.concatenate([self.forces.target, [self.volume * self.force_norm]])

    def columns(self, points: Indices) -> Array:
        """What some points add with their full weights, (e, c) float64."""
        return np.vstack([self.forces.columns(points), self.volume_shares[points]])

    def correlations(self, residual: Array) -> Array:
        """Every allowed column times a residual (e,); returns (s,) float64, −inf for points not allowed."""
        correlations = self.forces.correlations(residual[:-1])
        allowed = np.full(self.n_points, -np.inf)
        allowed[self.allowed] = (correlations + residual[-1] * self.volume_shares)[self.allowed]
        return allowed

    def error(self, residual: Array) -> float:
        """Relative error of the forces alone."""
        return float(np.linalg.norm(residual[:-1])) / self.force_norm


@dataclass(frozen=True, eq=False)
class Candidates:
    """Some points, their columns and the multipliers x ≥ 0 of those chosen among them; the rest have x = 0.

    Every method returns new candidates. Columns are of unit length, `norms` (m,) what they were divided by; x fits the
    unit columns. gram (m, m) is their Gram matrix and residual (e,) what is left of the target.
    """

    system: System
    points: Indices
    columns: Array
    norms: Array
    gram: Array
    moments: Array
    x: Array
    residual: Array

    @classmethod
    def none(cls, system: System) -> Candidates:
        """Nothing chosen yet, nothing at work."""
        nothing, equations = np.empty(0), len(system.target)
        points = np.empty(0, dtype=np.int64)
        columns, gram = np.empty((equations, 0)), np.empty((0, 0))
        return cls(system, points, columns, nothing, gram, nothing, nothing, system.target)

    @property
    def size(self) -> int:
        """The number of points chosen."""
        return int((self.x > 0).sum())

    @property
    def error(self) -> float:
        """Relative error of the forces."""
        return self.system.error(self.residual)

    @property
    def multipliers(self) -> Array:
        """Share of its full weight that each chosen point has, (c,) float64, in the order of `chosen`."""
        positive = self.x > 0
        return self.x[positive] / self.norms[positive]

    @property
    def chosen(self) -> Indices:
        """The points with a positive multiplier, (c,)."""
        return self.points[self.x > 0]

    def refreshed(self, count: int) -> Candidates:
        """The chosen points and, as new company, the `count` others best correlated with the residual."""
        correlations = self.system.correlations(self.residual)
        correlations[self.chosen] = -np.inf
        best = np.argsort(-correlations, kind="stable")[:count]
        return self.among(best[correlations[best] > 0])

    def among(self, others: Indices) -> Candidates:
        """The chosen points and others as their new company."""
        return self._only_chosen()._with_points(others)

    def solved_on(self, points: Indices) -> Candidates:
        """The non-negative solution on some points, whatever was chosen before."""
        fresh = Candidates.none(self.system)._with_points(points)
        return fresh._at(nnls(fresh.gram, fresh.moments))

    def given(self, points: Indices, multipliers: Array) -> Candidates:
        """Points with multipliers that nothing was solved for."""
        fresh = Candidates.none(self.system)._with_points(points)
        return fresh._at(multipliers * fresh.norms)

    def with_best(self) -> Candidates | None:
        """With the candidate chosen whose unit column correlates best; None where no correlation is positive."""
        gradient = self.residual @ self.columns
        gradient[self.x > 0] = -np.inf
        if len(gradient) == 0 or not gradient.max() > 0:
            return None
        support = self.x > 0
        support[np.argmax(gradient)] = True
        return self._solved(support)

    def without_least(self) -> Candidates:
        """Without the point whose leaving costs least."""
        support = self.x > 0
        support[np.argmin(losses_without(self.gram, self.x))] = False
        return self._solved(support)

    def _solved(self, support: NDArray[np.bool_]) -> Candidates:
        return self._at(solve_on_support(self.gram, self.moments, np.where(support, self.x, 0.0), support))

    def _at(self, x: Array) -> Candidates:
        return replace(self, x=x, residual=self.system.target - self.columns @ x)

    def _only_chosen(self) -> Candidates:
        keep = np.flatnonzero(self.x > 0)
        return replace(
            self,
            points=self.points[keep],
            columns=self.columns[:, keep],
            norms=self.norms[keep],
            gram=self.gram[np.ix_(keep, keep)],
            moments=self.moments[keep],
            x=self.x[keep],
        )

    def _with_points(self, points: Indices) -> Candidates:
        new = self.system.columns(points)
        norms = np.linalg.norm(new, axis=0)
        norms[norms == 0] = 1.0  # a cell whose vertices are all pinned adds nothing, whatever its multiplier
        new /= norms
        mixed = self.columns.T @ new
        return replace(
            self,
            points=np.concatenate([self.points, points]),
            columns=np.hstack([self.columns, new]),
            norms=np.concatenate([self.norms, norms]),
            gram=np.block([[self.gram, mixed], [mixed.T, new.T @ new]]),
            moments=np.concatenate([self.moments, new.T @ self.system.target]),
            x=np.concatenate([self.x, np.zeros(len(points))]),
        )
