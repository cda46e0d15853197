"""What a session keeps in mind: grabs, the page's choices, who listens, and the statistics between two frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ldsim.simulator import Handle, Outcome, Simulator, StepRecord
from ldsim.viewer.payload import SpaceFrame

Array = NDArray[np.float64]

# From the best to the worst; the page knows an outcome by its place here.
OUTCOMES = tuple(Outcome)


@dataclass
class Held:
    """A grab of a page in every space that is shown."""

    client: int
    target: Array
    handles: list[Handle]


@dataclass
class Look:
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


@dataclass
class Statistics:
    """Of the steps since the last frame, in one space."""

    seconds: list[float] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)
    evaluations: list[int] = field(default_factory=list)
    worst: Outcome = Outcome.SOLVED

    def add(self, record: StepRecord) -> None:
        """Count one more step."""
        self.seconds.append(record.seconds)
        self.iterations.append(record.iterations)
        self.evaluations.append(record.evaluations)
        self.worst = max(self.worst, record.outcome, key=OUTCOMES.index)


def space_frame(simulator: Simulator, statistics: Statistics) -> SpaceFrame:
    """What a frame says of one space; of the full one only the surface is sent."""
    q = simulator.coordinates
    if simulator.space.basis is None:
        q = q.reshape(-1, 3)[simulator.surface.vertices].ravel()
    return SpaceFrame(
        q.astype(np.float32),
        1e3 * float(np.median(statistics.seconds)),
        float(np.mean(statistics.iterations)),
        float(np.mean(statistics.evaluations)),
        OUTCOMES.index(statistics.worst),
        sum(count for outcome, count in simulator.counts.items() if outcome != Outcome.SOLVED),
        simulator.novelty,
    )
