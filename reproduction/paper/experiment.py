"""What an experiment of the paper is: a function that makes the runs it needs and returns a picture and relations."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from reproduction.harness import Harness

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
        paper: the same number in the paper or in its authors' data, where there is one.
    """

    claim: str
    value: float | None
    goal: str
    paper: float | None = None

    @property
    def holds(self) -> bool:
        sign, limit = self.goal.split()
        return self.value is not None and math.isfinite(self.value) and COMPARISONS[sign](self.value, float(limit))

    def record(self) -> dict[str, Any]:
        """For JSON, which knows no infinities."""
        value = self.value if self.value is not None and math.isfinite(self.value) else None
        return {"claim": self.claim, "value": value, "goal": self.goal, "holds": self.holds, "paper": self.paper}


@dataclass(frozen=True, eq=False)
class Outcome:
    """What an experiment found.

    Attributes:
        figure: SVG.
        numbers: behind it, for JSON.
        relations: of the paper.
        still: solids in the spaces compared, WebP, where the paper shows them.
    """

    figure: str
    numbers: Mapping[str, Any]
    relations: tuple[Relation, ...]
    still: bytes | None = None


@dataclass(frozen=True)
class Experiment:
    """An entry of the table.

    Attributes:
        shows: what the paper shows, in a few words.
        run: shows it here.
        paper: what the paper says and measured, and how this experiment differs from it.
        found: what the full size showed, and why, where a relation does not hold.
    """

    shows: str
    run: Callable[[Harness], Outcome]
    paper: str
    found: str = ""
