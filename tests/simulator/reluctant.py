"""Tries of a step that end as they are told, and what a simulator is to make of them, in Python and in C."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ldsim.arrays import Array
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.stepper import Stepper
from ldsim.mechanics.loads import Loads
from ldsim.optimise.solution import Reason, Solution
from ldsim.simulator import Outcome


class Try(NamedTuple):
    """Why the minimiser is said to have stopped, and whether where it led is out of bounds."""

    reason: Reason
    away: bool = False


class Ending(NamedTuple):
    """The first tries of a step, what it comes to, and why the try stopped that is told of, by its number."""

    tries: tuple[Try, ...]
    outcome: Outcome
    reason: Reason
    taken: int


STUCK, LOST, AWAY = Try(Reason.NO_DECREASE), Try(Reason.INFINITE_START), Try(Reason.CONVERGED, away=True)
ENDINGS = {
    "stuck": Ending((STUCK,), Outcome.SOLVED, Reason.CONVERGED, 1),
    "stuck twice": Ending((STUCK, STUCK), Outcome.SHORT, Reason.NO_DECREASE, 1),
    "stuck, then out of bounds": Ending((STUCK, AWAY), Outcome.SHORT, Reason.NO_DECREASE, 0),
    "stuck, then lost": Ending((STUCK, LOST), Outcome.SHORT, Reason.NO_DECREASE, 0),
    "stuck out of bounds": Ending((Try(Reason.NO_DECREASE, away=True),), Outcome.SLOWED, Reason.CONVERGED, 1),
    "spent": Ending((Try(Reason.ITERATIONS_SPENT),), Outcome.SHORT, Reason.ITERATIONS_SPENT, 0),
    "lost": Ending((LOST,), Outcome.SLOWED, Reason.CONVERGED, 1),
    "out of bounds": Ending((AWAY,), Outcome.SLOWED, Reason.CONVERGED, 1),
    "lost twice": Ending((LOST, LOST), Outcome.HELD, Reason.INFINITE_START, 1),
    "lost, then out of bounds": Ending((LOST, AWAY), Outcome.HELD, Reason.CONVERGED, 1),
}


class Reluctant(Stepper[ReducedState]):
    """Ends its first tries as it is told before it goes on as another.

    Attributes:
        made: what came of every try; the norm of a gradient is its number.
    """

    def __init__(self, other: ReducedStepper, tries: Sequence[Try] = ()) -> None:
        self._other, self._tries = other, list(tries)
        self._away = list[ReducedState]()
        self.made = list[tuple[ReducedState, Solution]]()
        self.rest, self.stiffened = other.rest, other.stiffened  # type: ignore[method-assign, assignment]
        self.displacement = other.displacement  # type: ignore[method-assign]

    def told(self, tries: Sequence[Try]) -> None:
        """End the next tries so."""
        self._tries = list(tries)

    def step(self, state: ReducedState, loads: Loads) -> tuple[ReducedState, Solution]:
        advanced, solution = self._other.step(state, loads)
        if self._tries:
            told = self._tries.pop(0)
            solution = solution._replace(reason=told.reason)
            self._away += [advanced] * told.away
        self.made.append((advanced, solution._replace(gradient_norm=float(len(self.made)))))
        return self.made[-1]

    def within(self, state: ReducedState, limit: float) -> bool:
        return self._other.within(state, limit) and not any(state is away for away in self._away)

    def coordinates(self, state: ReducedState) -> Array:
        return self._other.coordinates(state)
