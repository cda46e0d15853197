"""What a session keeps in mind: the page's choices, who listens, and what a frame says of a space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ldsim.simulator import Outcome, Simulator, StepRecord
from ldsim.viewer.payload import SpaceFrame

# From the best to the worst; the page knows an outcome by its place here.
OUTCOMES = tuple(Outcome)


@dataclass
class PageLook:
    """What the page has chosen."""

    gravity: tuple[float, float, float]
    stiffness: float = 1.0
    speed: float = 1.0
    paused: bool = False
    colour: str = "plain"


@dataclass
class Audience:
    """Where frames, texts and whole blocks go; called from the stepping thread."""

    frame: Callable[[bytes], object]
    colours: Callable[[int, bytes], object]
    status: Callable[[dict[str, object]], object]
    notice: Callable[[str], object]


class Errors:
    """How far the spaces shown are from the full one beside them, now and since the last start from rest."""

    def __init__(self) -> None:
        self.now: dict[str, float] = {}
        self._sums: dict[str, float] = {}
        self._moved = 0.0

    def add(self, shown: Sequence[Simulator]) -> None:
        """Compare the shapes after a step."""
        full = next((simulator.displacement() for simulator in shown if simulator.space.basis is None), None)
        self.now = {}
        if full is None:
            return
        self._moved += float(np.linalg.norm(full, axis=1).mean())
        for simulator in shown:
            if simulator.space.basis is not None:
                name, off = simulator.space.name, np.linalg.norm(simulator.displacement() - full, axis=1).mean()
                self.now[name] = float(off)
                self._sums[name] = self._sums.get(name, 0.0) + float(off)

    def of(self, name: str) -> tuple[float, float]:
        """The mean distance now, metres, and the online error; NaN where nothing is known."""
        known = name in self.now and self._moved > 0
        return self.now.get(name, np.nan), self._sums[name] / self._moved if known else np.nan


def space_frame(simulator: Simulator, records: Sequence[StepRecord], error: tuple[float, float]) -> SpaceFrame:
    """What a frame says of one space and its steps since the last one; of the full space only the surface is sent."""
    q = simulator.coordinates
    if simulator.space.basis is None:
        q = q.reshape(-1, 3)[simulator.surface.vertices].ravel()
    steps = np.zeros((max(len(records), 1), 4))
    for row, record in zip(steps, records, strict=False):
        row[:] = record.seconds, record.iterations, record.evaluations, OUTCOMES.index(record.outcome)
    return SpaceFrame(
        q.astype(np.float32),
        1e3 * float(np.median(steps[:, 0])),
        float(steps[:, 1].mean()),
        float(steps[:, 2].mean()),
        int(steps[:, 3].max()),
        sum(count for outcome, count in simulator.counts.items() if outcome != Outcome.SOLVED),
        simulator.novelty,
        *error,
    )
