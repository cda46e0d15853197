"""What a session keeps in mind: grabs, the page's choices, who listens, and the statistics between two frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ldsim.simulator import Handle, Outcome

Array = NDArray[np.float64]


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
