"""Pins that are moved while the simulator steps, in every kind of space."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.stepper import Stepper
from ldsim.errors import MotionError
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.motion import Motion, Support
from ldsim.mechanics.pins import MovedPins
from ldsim.simulator import Outcome, Simulator, full_simulator
from ldsim.space.decoder import Decoder
from ldsim.space.lifting import Lifting
from tests.simulator.playable import curved_decoder
from tests.simulator.simulators import BODY, TIP, UP, kinds, reduced


def path(frames: int) -> list[tuple[MovedPins, ...]]:
    """Where the pins are, frame by frame: all of them carried and turned along a crooked path."""
    turns = np.random.default_rng(6).normal(size=(frames, 3, 4)) * [0.02, 0.02, 0.02, 0.003]
    return [(MovedPins(np.flatnonzero(BODY.pinned), map),) for map in np.eye(3, 4) + np.cumsum(turns, axis=0)]


def with_moving_pins() -> list[tuple[Simulator, Stepper[Any]]]:
    """A simulator of each kind whose pins can move, and a stepper like its own."""
    support = Support(np.flatnonzero(BODY.pinned), np.eye(3, 4)[None])
    lifting = Lifting.of(BODY, [Motion("moving", 1, supports=(support,))])
    found: list[tuple[Simulator, Stepper[Any]]] = []
    for decoder in (curved_decoder(), Decoder.identity(9)):
        simulator = reduced(decoder=decoder, lifting=lifting)
        alone = ReducedStepper(simulator.space, ReducedOptions(tolerance=1e-9, max_iterations=500))
        found.append((simulator, alone))
    return [*found, (full_simulator(BODY, 1e-9), FullStepper(BODY, FullOptions(tolerance=1e-9)))]


@kinds
def test_pins_that_are_moved_are_those_of_the_loads_of_a_step(kind: int) -> None:
    simulator, stepper = with_moving_pins()[kind]
    handle = simulator.grab(TIP, TIP + UP, stiffness=40, at_rest=True)
    grabs, state = (Grab(handle.vertices, handle.target, 40.0),), stepper.rest()
    for pins in path(6):
        simulator.set_pins(pins)
        assert simulator.step().outcome == Outcome.SOLVED
        state, _ = stepper.step(state, Loads(grabs, pins=pins))
        u = simulator.displacement()
        np.testing.assert_allclose(u, stepper.displacement(state), atol=1e-10)
        np.testing.assert_allclose(simulator.coordinates, stepper.coordinates(state), atol=1e-9)
        np.testing.assert_allclose(u[BODY.pinned], pins[0].displacement(BODY.mesh.vertices), atol=1e-12)
        np.testing.assert_allclose(handle.centroid, (BODY.mesh.vertices + u)[handle.vertices].mean(axis=0), atol=1e-12)
    assert np.abs(u[BODY.pinned]).max() > 0.005


@kinds
def test_pins_stay_where_they_were_put_until_reset_brings_them_back(kind: int) -> None:
    simulator, _ = with_moving_pins()[kind]
    simulator.step(3)
    expected = simulator.displacement()
    simulator.reset()
    (pins,) = path(1)
    simulator.set_pins(pins)
    simulator.step(4)
    held = simulator.displacement()[BODY.pinned]
    np.testing.assert_allclose(held, pins[0].displacement(BODY.mesh.vertices), atol=1e-12)
    simulator.reset()
    assert not simulator.displacement().any()
    simulator.step(3)
    np.testing.assert_array_equal(simulator.displacement(), expected)
    assert not expected[BODY.pinned].any()


@kinds
def test_a_saved_state_keeps_where_the_pins_are_and_how_fast_they_move(kind: int) -> None:
    simulator, _ = with_moving_pins()[kind]
    *before, last = path(4)
    for pins in before:
        simulator.set_pins(pins)
        simulator.step()
    simulator.set_pins(last)
    saved = simulator.save()
    simulator.step(3)
    expected = simulator.displacement()
    simulator.set_pins(())
    simulator.step(2)
    assert not simulator.displacement()[BODY.pinned].any()
    for _ in range(2):
        simulator.restore(saved)
        simulator.step(3)
        np.testing.assert_allclose(simulator.displacement(), expected, atol=1e-10)
        simulator.reset()


def test_pins_that_a_space_was_not_prepared_for_are_refused_and_the_state_kept() -> None:
    simulator = reduced()
    simulator.step(2)
    before = simulator.displacement()
    (pins,) = path(1)
    simulator.set_pins(pins)
    with pytest.raises(MotionError, match="pins move; the reduced space has no lifting for them"):
        simulator.step()
    np.testing.assert_array_equal(simulator.displacement(), before)
    simulator.set_pins(())
    assert simulator.step().outcome == Outcome.SOLVED


@kinds
def test_pins_that_mean_nothing_are_refused_and_the_old_ones_kept(kind: int) -> None:
    simulator, _ = with_moving_pins()[kind]
    pinned, free, map = np.flatnonzero(BODY.pinned), BODY.free[:2], np.eye(3, 4)
    bad = [
        ([MovedPins(free, map)], f"vertex {free[0]} is to move as pins do, but it is not pinned"),
        ([MovedPins(np.array([10**6]), map)], "from 1000000 to 1000000; they must be from 0 to 11"),
        ([MovedPins(pinned - len(BODY.pinned), map)], "; they must be from 0 to 11"),  # NumPy counts from the end
        ([MovedPins(pinned, np.eye(3))], "a map of moved pins is .*must be .A . b., .3, 4. finite numbers"),
        ([MovedPins(pinned, np.full((3, 4), np.nan))], "a map of moved pins is .*finite"),
        ([MovedPins(pinned, map), MovedPins(pinned, map)], f"vertex {pinned[0]} is moved twice"),
        ([(pinned, map)], "they must be MovedPins"),
    ]
    (pins,) = path(1)
    simulator.set_pins(pins)
    for moved, message in bad:
        with pytest.raises(MotionError, match=message):
            simulator.set_pins(moved)  # type: ignore[arg-type]
    simulator.step(3)
    np.testing.assert_allclose(simulator.displacement()[pinned], pins[0].displacement(BODY.mesh.vertices), atol=1e-12)
