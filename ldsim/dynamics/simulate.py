"""The time loop: a motion run frame by frame, by any stepper."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Generic, NamedTuple, TypeVar

from ldsim.arrays import Indices
from ldsim.dynamics.stepper import Stepper
from ldsim.mechanics.loads import MotionLoads
from ldsim.mechanics.motion import Motion
from ldsim.optimise.solution import Reason, Solution

S = TypeVar("S")

# A run that leaves the solid this many diagonals behind (root mean square over its mass) is lost.
FARTHEST = 10.0


class Frame(NamedTuple, Generic[S]):
    """One frame of a run.

    Attributes:
        number: of the frame in the motion.
        state: after its step.
        solution: the minimiser's record.
        seconds: that the step alone took.
        lost: whether the run is lost here: it led nowhere, to a state that is not finite, or too far away.
        held: the vertices of each drag so far.
    """

    number: int
    state: S
    solution: Solution
    seconds: float
    lost: bool
    held: Mapping[int, Indices]


def simulate(
    stepper: Stepper[S],
    motion: Motion,
    start: S | None = None,
    frames: range | None = None,
    held: Mapping[int, Indices] | None = None,
) -> Iterator[Frame[S]]:
    """Step through a motion, frame by frame: the one time loop. It ends with the motion, or where the run is lost.

    Args:
        start: the state before the first frame; rest where it is left out.
        frames: which frames of the motion; all where it is left out.
        held: vertices of drags that are settled already (`MotionLoads`).

    Raises:
        MotionError: the motion does not fit the solid.
    """
    loads = MotionLoads(motion, stepper.scene, dict(held or {}))
    state = stepper.rest() if start is None else start
    farthest = FARTHEST * stepper.scene.mesh.diagonal
    for number in range(motion.frames) if frames is None else frames:
        acting = loads.at(number, stepper.displacement(state) if loads.needs_state(number) else None)
        started = time.perf_counter()
        state, solution = stepper.step(state, acting)
        seconds = time.perf_counter() - started
        lost = solution.reason == Reason.INFINITE_START or not stepper.within(state, farthest)
        yield Frame(number, state, solution, seconds, lost, loads.held)
        if lost:
            return
