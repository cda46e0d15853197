"""What an experiment of the paper is: a function that makes the runs it needs and returns a picture and relations."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True)
class Relation:
    """A claim about one number.

    Attributes:
        claim: what is compared with what.
        value: the number that was measured; None or not finite where it could not be, which never holds.
        goal: a comparison such as "<= 0.5", as in the benchmarks' rows.
    """

    claim: str
    value: float | None
    goal: str

    @property
    def holds(self) -> bool:
        sign, limit = self.goal.split()
        return self.value is not None and math.isfinite(self.value) and COMPARISONS[sign](self.value, float(limit))

    def record(self) -> dict[str, Any]:
        """For JSON, which knows no infinities."""
        value = self.value if self.value is not None and math.isfinite(self.value) else None
        return {"claim": self.claim, "value": value, "goal": self.goal, "holds": self.holds}


@dataclass(frozen=True, eq=False)
class Outcome:
    """What an experiment found: a figure as SVG, the numbers behind it, and the paper's relations."""

    figure: str
    numbers: Mapping[str, Any]
    relations: tuple[Relation, ...]


class Bench(Protocol):
    """Where experiments are made: runs of the pipeline, and results that need not be made twice."""

    @property
    def quick(self) -> bool:
        """Whether a small version is wanted."""

    def made(self, configuration: Mapping[str, Any], last: str) -> Path:
        """The folder of a run that is finished up to the stage `last`; stages that are up to date are not run."""

    def file(self, name: str, text: str) -> Path:
        """A small input file with this content."""

    def remembered(self, name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """A result, computed once and kept; `name` must tell all that it depends on besides the runs made."""


@dataclass(frozen=True)
class Experiment:
    """An entry of the table: what the paper shows, and the function that shows it."""

    shows: str
    run: Callable[[Bench], Outcome]
