"""The path of a fit: the best rule found of every size, from one point up to the smallest that meets the tolerance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ldsim.arrays import Array
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.system import Candidates
from ldsim.cubature.terms import Term
from ldsim.errors import SolverError

Tell = Callable[[int, float], None]

POINTS_AT_ONCE = 512


@dataclass(frozen=True, eq=False)
class VirtualFit:
    """Virtual points, and what they were chosen among.

    Attributes:
        rule: with strain maps of its own; its errors are against forces that a closure may have moved.
        closure: share of the true poses' forces that it was fitted to.
        judged: the closures that were tried, and the error of each where the rule is used, (t, 2); the first line, with
            no closure, is the chosen rule on the mesh.
    """

    rule: CubatureRule
    closure: float
    judged: Array

    @property
    def worse_than_mesh(self) -> bool:
        """Whether the rule on the mesh was judged better by more than a tenth."""
        own = self.judged[1:][self.judged[1:, 0] == self.closure, 1]
        return bool(np.nanmin(own, initial=np.inf) > 1.1 * self.judged[0, 1])


@dataclass(frozen=True, eq=False)
class RulePath:
    """The cubature rules of one space.

    Attributes:
        rules: on the mesh, of growing size and falling error, (l).
        chosen: number of the rule that the fit was for: the smallest found that meets the tolerance, or else the one
            of least error.
        virtual: virtual points, fitted from one of the rules; None where there are none.

    Raises:
        SolverError: there is no rule of the number chosen, or one without points.
    """

    rules: tuple[CubatureRule, ...]
    chosen: int
    virtual: VirtualFit | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.chosen < len(self.rules) or not all(len(rule.points) for rule in self.rules):
            sizes = [len(rule.points) for rule in self.rules]
            raise SolverError(f"rule number {self.chosen} is chosen among rules of {sizes} points; each needs some")

    @property
    def best(self) -> CubatureRule:
        """The chosen rule on the mesh."""
        return self.rules[self.chosen]

    def stepped(self, points: int | None = None, changed_material: bool = False) -> CubatureRule:
        """The rule that a step takes: the virtual points, or else the chosen rule on the mesh.

        Args:
            points: take the largest rule on the mesh of at most so many points instead.
            changed_material: whether the solid has another material than the fit; virtual points are of the fit's own.
        """
        if points is not None:
            return self.at_most(points)
        return self.best if self.virtual is None or changed_material else self.virtual.rule

    def at_most(self, points: int) -> CubatureRule:
        """The largest rule on the mesh of at most so many points, or the smallest there is."""
        fitting = [rule for rule in self.rules if len(rule.points) <= points]
        return fitting[-1] if fitting else self.rules[0]

    def meets(self, tolerance: float) -> bool:
        """Whether the chosen rule has at most this relative error on the poses of its fit and on those kept back."""
        return self.worst_error <= tolerance

    @property
    def worst_error(self) -> float:
        """The larger of the chosen rule's relative errors on the poses of its fit and on those kept back."""
        return float(np.fmax(self.best.training_error, self.best.heldout_error))


class PathBuilder:
    """Keeps the best rule seen of each size while a method is at work.

    Args:
        tell: told the number of points and the relative error after each change.
    """

    def __init__(self, tell: Tell | None = None) -> None:
        self._rules: dict[int, CubatureRule] = {}
        self._tell = tell

    def record(self, state: Candidates) -> None:
        """Keep the rule of some candidates if it is better than those of its size."""
        error = state.error
        known = self._rules.get(state.size)
        if state.size and (known is None or error < known.training_error):
            order = np.argsort(state.chosen)
            points = state.chosen[order]
            weights = state.multipliers[order] * state.system.forces.point_weights[points]
            self._rules[state.size] = CubatureRule(points, weights, error)
        if self._tell is not None:
            self._tell(state.size, error)

    def path(self, tolerance: float) -> RulePath:
        """Sizes upwards, leaving out what is no better than a smaller rule, to the first that meets the tolerance."""
        rules: list[CubatureRule] = []
        for _, rule in sorted(self._rules.items()):
            if rules and rule.training_error >= rules[-1].training_error:
                continue
            rules.append(rule)
            if rule.training_error <= tolerance:
                break
        return RulePath(tuple(rules), len(rules) - 1)


def relative_errors(forces: Term, rules: Sequence[CubatureRule]) -> Array:
    """‖Σ w b − target‖ / ‖target‖ of each rule over the samples of a term, fitted or not, (l,).

    Raises:
        SolverError: a rule has points that the scene does not have.
    """
    errors: Array = np.linalg.norm(residuals(forces, rules), axis=0) / np.linalg.norm(forces.target)
    return errors


def residuals(forces: Term, rules: Sequence[CubatureRule]) -> Array:
    """target − Σ w b of each rule, (e, l) float64.

    Raises:
        SolverError: a rule has points that the scene does not have.
    """
    points = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(rule.points for rule in rules)]))
    full = forces.point_weights
    if len(points) and not (points[0] >= 0 and points[-1] < len(full)):
        raise SolverError(
            f"cubature rule has points {points[0]} … {points[-1]}, the scene has {len(full)}; use the scene it was "
            "fitted on"
        )
    multipliers = np.zeros((len(points), len(rules)))
    for i, rule in enumerate(rules):
        multipliers[np.searchsorted(points, rule.points), i] = rule.weights / full[rule.points]
    left = np.repeat(forces.target[:, None], len(rules), axis=1)
    for first in range(0, len(points), POINTS_AT_ONCE):  # the columns of all points at once may not fit in memory
        chunk = slice(first, first + POINTS_AT_ONCE)
        left -= forces.columns(points[chunk]) @ multipliers[chunk]
    return left
