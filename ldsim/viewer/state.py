"""What a session keeps in mind: grabs, the page's choices, who listens, and what a frame says of a space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

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


def space_frame(simulator: Simulator, records: Sequence[StepRecord]) -> SpaceFrame:
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
    )
