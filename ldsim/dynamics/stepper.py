"""What steps: the protocol of a stepper, which takes a state and what acts on it to the next state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene
from ldsim.optimise.solution import Solution

S = TypeVar("S")


class Stepper(Protocol[S]):
    """Steps a scene in one space. It keeps nothing of a run: states are never changed, so any can be gone back to.

    A state makes of itself, by `standing()`, the same shape without velocity, and by `renewed()` the same motion, with
    nothing kept from earlier steps.
    """

    @property
    def scene(self) -> Scene: ...

    def rest(self) -> S:
        """The undeformed solid, without velocity."""
        ...

    def state(
        self,
        u: NDArray[np.floating],
        u_previous: NDArray[np.floating],
        pins: tuple[Sequence[MovedPins], Sequence[MovedPins]] = ((), ()),
    ) -> S:
        """The state nearest to the last two frames, (n, 3) metres each, the later first, and where pins were."""
        ...

    def step(self, state: S, loads: Loads) -> tuple[S, Solution]:
        """Advance by one time step."""
        ...

    def displacement(self, state: S) -> Array:
        """u, (n, 3) float64, metres."""
        ...

    def coordinates(self, state: S) -> Array:
        """What describes the shape: q in a reduced space, and where its pins are; u (3n,) in the full one."""
        ...

    def within(self, state: S, limit: float) -> bool:
        """Whether the root mean square displacement, weighted by mass, is at most so many metres; not if it is NaN."""
        ...

    def stiffened(self, scale: float) -> Stepper[S]:
        """The same steps with the Lamé parameters that the first stepper was made with times a positive number."""
        ...
