"""What a simulator hands out: the record of a step, the surface, a state to come back to."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from ldsim.arrays import Array
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.pins import MovedPins
from ldsim.optimise.solution import Reason


class Outcome(Enum):
    """What came of a step."""

    SOLVED = "solved"
    SHORT = "the minimiser stopped before its tolerance; the best point that it found was taken"
    SLOWED = "no step in motion stayed finite and in bounds; it was taken from standstill"
    HELD = "no step stayed finite and in bounds; the shape was kept: ease the grabs, or restore or reset the state"


@dataclass(frozen=True)
class StepRecord:
    """The statistics of one step.

    Attributes:
        number: of the step since the last reset, from 1.
        seconds: it took.
        iterations, evaluations: of the minimiser, retries included.
        reason: why the minimiser stopped.
        gradient_norm: ‖∇E‖ where it stopped, N.
        outcome: what came of it.
    """

    number: int
    seconds: float
    iterations: int
    evaluations: int
    reason: Reason
    gradient_norm: float
    outcome: Outcome

    @property
    def message(self) -> str:
        """One line in words; empty where all went well."""
        if self.outcome == Outcome.SOLVED:
            return ""
        return f"step {self.number}: {self.reason.words}; {self.outcome.value}"


@dataclass(frozen=True, eq=False)
class SavedState:
    """All that the next step depends on; made by `Simulator.save`."""

    state: Any
    before: Any
    grabs: dict[int, Grab] = field(repr=False)
    pins: tuple[MovedPins, ...]
    gravity: Array | None
    material_scale: float
    number: int
