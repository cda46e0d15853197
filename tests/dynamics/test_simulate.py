"""The one time loop: a plain loop of steps in every space, which stops where a run is lost and can be continued."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import FARTHEST, simulate
from ldsim.dynamics.stepper import Stepper
from ldsim.mechanics.loads import Loads, MotionLoads
from ldsim.mechanics.motion import Drag, Motion, Support
from ldsim.mesh.shapes import beam
from ldsim.optimise.solution import Reason, Solution
from ldsim.space.decoder import Decoder
from ldsim.space.lifting import Lifting
from tests.dynamics.reduced.solids import curved
from tests.helpers import reduced_space, scene, smooth_basis

Array = NDArray[np.float64]

BODY = scene(beam(resolution=1), youngs_modulus=3e4)
FRAMES = 12


def busy() -> Motion:
    """Two drags, the second settled on the deformed solid; gravity that turns; pins that move."""
    tip = BODY.mesh.vertices[BODY.mesh.vertices[:, 0].argmax()]
    targets = tip + np.linspace(0, 1, 5)[:, None] * [0.0, 0.04, 0.02]
    drags = (Drag(1, tip, targets, 0.02, 30.0), Drag(7, tip, targets[::-1], 0.02, 20.0))
    rng = np.random.default_rng(2)
    maps = np.eye(3, 4) + np.cumsum(rng.normal(size=(FRAMES, 3, 4)) * [0.01, 0.01, 0.01, 0.002], axis=0)
    gravity = 3 * rng.normal(size=(FRAMES, 3))
    return Motion("busy", FRAMES, drags, gravity, (Support(np.flatnonzero(BODY.pinned), maps),))


def full() -> FullStepper:
    return FullStepper(BODY, FullOptions(tolerance=1e-8))


def reduced(decoder: Decoder) -> ReducedStepper:
    space = reduced_space(BODY, smooth_basis(BODY, 6), decoder, lifting=Lifting.of(BODY, [busy()]))
    return ReducedStepper(space, ReducedOptions(tolerance=1e-8))


STEPPERS: dict[str, Callable[[], Stepper[Any]]] = {
    "full": full,
    "linear": lambda: reduced(Decoder.identity(6)),
    "latent": lambda: reduced(curved(6, 4)),
}
every_stepper = pytest.mark.parametrize("make", STEPPERS.values(), ids=STEPPERS)


@every_stepper
def test_simulating_is_a_plain_loop_of_steps(make: Callable[[], Stepper[Any]]) -> None:
    stepper, loads = make(), MotionLoads(busy(), BODY)
    frames = list(simulate(make(), busy()))
    state = stepper.rest()
    for number, frame in enumerate(frames):
        state, solution = stepper.step(state, loads.at(number, stepper.displacement(state)))
        np.testing.assert_array_equal(stepper.displacement(frame.state), stepper.displacement(state))
        assert (frame.number, frame.solution, frame.lost) == (number, solution, False)
        assert frame.seconds > 0
    assert len(frames) == FRAMES
    assert frames[-1].held.keys() == loads.held.keys() == {0, 1}
    for i, vertices in loads.held.items():
        np.testing.assert_array_equal(frames[-1].held[i], vertices)
    assert np.abs(stepper.displacement(state)).max() > 5e-3


@every_stepper
@pytest.mark.parametrize("cut", [3, 6, 9])
def test_a_run_is_continued_exactly(make: Callable[[], Stepper[Any]], cut: int) -> None:
    whole = list(simulate(make(), busy()))
    *_, last = simulate(make(), busy(), frames=range(cut))
    rest = list(simulate(make(), busy(), last.state, range(cut, FRAMES), last.held))
    assert [frame.number for frame in rest] == list(range(cut, FRAMES))
    stepper = make()
    for found, expected in zip(rest, whole[cut:], strict=True):
        np.testing.assert_array_equal(stepper.displacement(found.state), stepper.displacement(expected.state))
        assert found.solution == expected.solution


def test_vertices_that_were_held_are_held_on_wherever_the_solid_is() -> None:
    *_, last = simulate(full(), busy(), frames=range(3))
    before = {drag: vertices.copy() for drag, vertices in last.held.items()}
    (frame,) = simulate(full(), busy(), frames=range(3, 4), held=last.held)
    assert frame.held.keys() == before.keys() == {0}
    np.testing.assert_array_equal(frame.held[0], before[0])


class Losing(Stepper[ReducedState]):
    """Goes on as another, but for one step whose state or reason is changed."""

    def __init__(self, other: ReducedStepper, at: int, spoil: Callable[[ReducedState], None], reason: Reason) -> None:
        self._other, self._at, self._spoil, self._reason, self._count = other, at, spoil, reason, 0
        self.rest, self.within = other.rest, other.within  # type: ignore[method-assign]
        self.displacement = other.displacement  # type: ignore[method-assign]

    @property
    def scene(self) -> Any:
        return self._other.scene

    def step(self, state: ReducedState, loads: Loads) -> tuple[ReducedState, Solution]:
        state, solution = self._other.step(state, loads)
        self._count += 1
        if self._count == self._at + 1:
            self._spoil(state)
            solution = solution._replace(reason=self._reason)
        return state, solution


def made_nan(state: ReducedState) -> None:
    state.q[:] = np.nan


def sent(diagonals: float) -> Callable[[ReducedState], None]:
    """Moves the solid so far, root mean square over its mass."""

    def spoil(state: ReducedState) -> None:
        size = diagonals * BODY.mesh.diagonal * np.sqrt(BODY.mass.sum())
        state.q[:] = 0.0
        state.q[0] = size

    return spoil


def kept(state: ReducedState) -> None:
    """Leaves it as it is."""


@pytest.mark.parametrize(
    ("spoil", "reason", "lost"),
    [
        (made_nan, Reason.CONVERGED, True),
        (sent(1.01 * FARTHEST), Reason.CONVERGED, True),
        (sent(0.99 * FARTHEST), Reason.CONVERGED, False),
        (kept, Reason.INFINITE_START, True),
        (kept, Reason.NO_DECREASE, False),
        (kept, Reason.ITERATIONS_SPENT, False),
    ],
    ids=["not finite", "too far", "far", "infinite", "no decrease", "iterations spent"],
)
def test_a_run_ends_with_the_frame_in_which_it_is_lost(
    spoil: Callable[[ReducedState], None], reason: Reason, lost: bool
) -> None:
    stepper = Losing(reduced(Decoder.identity(6)), 4, spoil, reason)
    made = []
    for frame in simulate(stepper, busy()):
        made.append(frame)
        if len(made) == 5:
            break
    assert [frame.lost for frame in made] == [False] * 4 + [lost]
    if lost:
        assert len(list(simulate(Losing(reduced(Decoder.identity(6)), 4, spoil, reason), busy()))) == 5
