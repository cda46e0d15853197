"""What the pages hold, in every space that is shown, and the poses that an undo comes back to."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ldsim.arrays import Array
from ldsim.errors import LdsimError
from ldsim.simulator import Handle, SavedState, Simulator
from ldsim.viewer import protocol
from ldsim.viewer.payload import GrabFrame

# Poses kept for undo. A full space of 3,000 vertices takes 0.15 MB for one.
POSES = 50


@dataclass
class Held:
    """A grab of a page, in every space that is shown."""

    client: int
    target: Array
    handles: list[Handle]


@dataclass(frozen=True, eq=False)
class KeptPose:
    """All that was there before a pull: the states of the spaces shown, what was held in them, and the time.

    Attributes:
        left: what was held by pages that have left since.
    """

    simulators: Sequence[Simulator]
    states: Sequence[SavedState]
    held: dict[int, Held]
    seconds: float
    left: list[Held] = field(default_factory=list)


class Hands:
    """The grabs of all pages, by the number that the page gave.

    Attributes:
        held: what is held now.
    """

    def __init__(self) -> None:
        self.held: dict[int, Held] = {}
        self._poses: deque[KeptPose] = deque(maxlen=POSES)

    def frames(self) -> list[GrabFrame]:
        """What a frame says of them."""
        return [GrabFrame(key, held.target, [h.centroid for h in held.handles]) for key, held in self.held.items()]

    def grab(
        self,
        client: int,
        message: protocol.GrabMessage,
        simulators: Sequence[Simulator],
        take_hold: Callable[[Simulator], Handle],
    ) -> None:
        """Take hold in every space, or in none."""
        handles = list[Handle]()
        try:
            for simulator in simulators:
                handles.append(take_hold(simulator))
        except LdsimError:
            for handle in handles:
                handle.release()
            raise
        self.held[message.id] = Held(client, np.array(message.target), handles)

    def move(self, key: int, target: Array) -> bool:
        """Pull to another target; false where nothing of this number is held."""
        held = self.held.get(key)
        if held is None:
            return False
        held.target = target
        for handle in held.handles:
            handle.move(target)
        return True

    def release(self, key: int) -> bool:
        """Let go; false where nothing of this number is held."""
        held = self.held.pop(key, None)
        for handle in held.handles if held is not None else ():
            handle.release()
        return held is not None

    def of(self, client: int) -> list[int]:
        """The numbers of what a page holds."""
        return [key for key, held in self.held.items() if held.client == client]

    def carry_over(self, before: Sequence[Simulator], shown: Sequence[Simulator]) -> None:
        """Other spaces are shown: those that come hold what the first of those before held."""
        for held in self.held.values():
            kept = dict(zip(before, held.handles, strict=True))
            held.handles = [kept.get(each) or held.handles[0].on(each) for each in shown]

    def remember(self, shown: Sequence[Simulator], seconds: float) -> None:
        """Keep the present pose for an undo."""
        held = {key: replace(each, handles=list(each.handles)) for key, each in self.held.items()}
        self._poses.append(KeptPose(tuple(shown), [simulator.save() for simulator in shown], held, seconds))

    def forget(self) -> None:
        """Drop the last pose kept: what it was kept for did not happen."""
        self._poses.pop()

    def leave(self, client: int) -> None:
        """A page has left: what it held in poses that are kept comes back with none of them."""
        for pose in self._poses:
            for key in [key for key, held in pose.held.items() if held.client == client]:
                pose.left.append(pose.held.pop(key))

    def undo(self, shown: Sequence[Simulator]) -> float:
        """Back to the last pose kept; returns its time. Spaces that were not shown then take over from one that was.

        Raises:
            LdsimError: there is none.
        """
        if not self._poses:
            raise LdsimError("nothing to undo: undo goes back to before the last pull, motion or return to rest")
        pose = self._poses[-1]
        for simulator, state in zip(pose.simulators, pose.states, strict=True):
            simulator.restore(state)
        self._poses.pop()
        for gone in pose.left:  # before others take over what is held
            for handle in gone.handles:
                handle.release()
        for simulator in shown:
            if simulator not in pose.simulators:
                simulator.follow(pose.simulators[0])
        self.held = pose.held
        self.carry_over(pose.simulators, shown)
        return pose.seconds
