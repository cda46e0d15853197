"""Keyframes become grabs, moving pins and gravity at the right times."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.errors import MotionError
from ldsim.mechanics.options import ScriptOptions
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.script import (
    Path,
    frame_times,
    frames_until,
    grab_along,
    gravity_sweep,
    rotations,
    scripted,
    support_along,
)
from ldsim.mesh.shapes import beam
from tests.helpers import scene

STEP = [(1.0, (0.0,)), (2.0, (10.0,)), (4.0, (6.0,))]


def test_a_path_stays_before_and_after_its_keyframes_and_meets_each() -> None:
    for eased in (False, True):
        path = Path.of(STEP, eased)
        np.testing.assert_allclose(path.at(np.array([0.0, 1, 2, 4, 9]))[:, 0], [0, 0, 10, 6, 6], atol=1e-12)


def test_a_straight_path_goes_at_constant_speed_and_an_eased_one_starts_and_stops_at_rest() -> None:
    times = np.linspace(1, 2, 1001)
    straight, eased = (np.diff(Path.of(STEP, eased).at(times)[:, 0]) for eased in (False, True))
    np.testing.assert_allclose(straight, 0.01, rtol=1e-9)
    assert eased.min() >= 0
    assert max(eased[0], eased[-1]) < 5e-3 * eased.max()
    assert Path.of(STEP, True).at(np.array([1.5]))[0, 0] == pytest.approx(5)


def test_frame_i_is_the_state_at_i_plus_one_steps() -> None:
    assert frame_times(3, 0.1).tolist() == pytest.approx([0.1, 0.2, 0.3])
    assert [frames_until(time, 0.1) for time in (0.0, 0.3, 0.3 + 1e-9, 0.39, 0.4)] == [1, 3, 3, 3, 4]


def test_a_grab_pulls_in_the_frames_between_its_first_and_last_keyframe() -> None:
    path = Path.of([(0.2, (0.0, 0, 0)), (0.6, (4.0, 0, 0))], False)
    drag = grab_along(path, (1, 2, 3), 0.1, 7.0, True, 0.1)
    assert (drag.start, drag.stop) == (1, 6)
    np.testing.assert_allclose(drag.targets[:, 0], [0, 1, 2, 3, 4], atol=1e-12)
    between = Path.of([(0.21, (0.0, 0, 0)), (0.29, (1.0, 0, 0))], False)
    with pytest.raises(MotionError, match="a grab from 0.21 to 0.29 s holds no frame; they are 0.1 s apart"):
        grab_along(between, (0, 0, 0), 1, 1, True, 0.1)


def test_pins_turn_about_their_axis_through_their_centre() -> None:
    rest = np.array([[1.0, 0, 0], [1, 1, 0], [1, 0, 2.0], [5, 5, 5]])
    path = Path.of([(0.0, (0, 0, 0, 0)), (1.0, (0, 0, 0.5, np.pi / 2))], False)
    support = support_along(path, np.array([0, 1, 2]), (1, 0, 0), (0, 0, 3.0), np.array([0.0, 1.0]))
    start, end = (MovedPins(support.vertices, map) for map in support.maps)
    assert not start.displacement(rest).any()
    moved = rest[:3] + end.displacement(rest)
    np.testing.assert_allclose(moved, [[1, 0, 0.5], [0, 0, 0.5], [1, 0, 2.5]], atol=1e-12)


def test_rotations_are_rotations_and_add_up() -> None:
    axis = np.array([1.0, 2, -2]) / 3
    first, second, both = rotations(axis, np.array([0.4, 1.1, 1.5]))
    np.testing.assert_allclose(first @ first.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(first) == pytest.approx(1)
    np.testing.assert_allclose(first @ second, both, atol=1e-14)
    np.testing.assert_allclose(first @ axis, axis, atol=1e-14)


def test_pins_that_start_away_from_rest_or_turn_about_nothing_are_refused() -> None:
    away = Path.of([(0.0, (0, 0, 1, 0)), (1.0, (0, 0, 2, 0))], False)
    with pytest.raises(MotionError, match="must start at rest: the keyframe at 0 s has translation"):
        support_along(away, np.array([0]), (0, 0, 0), (0, 0, 1), np.array([1.0]))
    with pytest.raises(MotionError, match="must have a direction"):
        support_along(Path.of(STEP, True), np.array([0]), (0, 0, 0), (0, 0, 0), np.array([1.0]))


def test_a_gravity_sweep_comes_near_every_direction_from_its_start_to_the_opposite() -> None:
    start = np.array([0.0, -9.8, 0.0])
    swept = gravity_sweep(start, 600, turns=6)
    np.testing.assert_allclose(np.linalg.norm(swept, axis=1), 9.8)
    np.testing.assert_allclose(swept[-1], -start, atol=1e-9)
    assert np.degrees(np.arccos(swept[0] @ start / 9.8**2)) < 6
    anywhere = np.random.default_rng(0).normal(size=(500, 3))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    nearest = np.degrees(np.arccos(np.clip(anywhere @ swept.T / 9.8, -1, 1))).min(axis=1)
    assert nearest.max() < 180 / 6
    octants = np.bincount(((swept > 0) @ [1, 2, 4]), minlength=8) / 600
    assert np.abs(octants - 1 / 8).max() < 0.02


def test_a_gravity_sweep_of_no_size_is_refused() -> None:
    with pytest.raises(MotionError, match="size 0"):
        gravity_sweep((0, 0, 0), 10, 1)


def test_a_grab_that_begins_when_the_motion_is_over_is_refused() -> None:
    keyframes = [{"time": time, "target": (0, 0, 0)} for time in (0.5, 1.0)]
    grab = {"point": (0, 0, 0), "keyframes": keyframes}
    body = scene(beam(resolution=1), time_step=0.1)
    assert scripted("a", body, ScriptOptions.model_validate({"grabs": [grab], "duration": 0.7})).frames == 7
    with pytest.raises(MotionError, match="a grab begins at 0.5 s, when the motion of 0.4 s is over"):
        scripted("a", body, ScriptOptions.model_validate({"grabs": [grab], "duration": 0.4}))
