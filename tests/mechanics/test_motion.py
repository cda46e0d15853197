"""Drags: which vertices they take hold of, when, and when they refuse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldsim.errors import MotionError
from ldsim.mechanics.grabs import held_vertices
from ldsim.mechanics.loads import MotionLoads
from ldsim.mechanics.motion import Drag, Motion, Support
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from tests.helpers import scene

LINE = np.stack([np.arange(11) / 10, np.zeros(11), np.zeros(11)], axis=1)
ALL_MOVE = np.ones(11, dtype=bool)


def drag(start: int = 0, point: float = 0.52, frames: int = 3, radius: float = 0.15) -> Drag:
    targets = np.arange(3.0 * frames).reshape(frames, 3)
    return Drag(start, np.array([point, 0.0, 0.0]), targets, radius, stiffness=7.0)


def test_a_drag_holds_the_vertices_around_the_one_nearest_to_its_point() -> None:
    np.testing.assert_array_equal(held_vertices(drag(), LINE, ALL_MOVE, reach=0.1), [4, 5, 6])


def test_the_radius_is_that_around_the_picked_vertex_not_around_the_point() -> None:
    near = drag(point=0.54, radius=0.11)
    np.testing.assert_array_equal(held_vertices(near, LINE, ALL_MOVE, reach=0.1), [4, 5, 6])


def test_pinned_vertices_are_not_held() -> None:
    movable = ALL_MOVE.copy()
    movable[5] = False
    np.testing.assert_array_equal(held_vertices(drag(), LINE, movable, reach=0.1), [4, 6])


def test_a_drag_of_pinned_vertices_alone_is_refused() -> None:
    with pytest.raises(MotionError, match="frame 0 holds only pinned vertices"):
        held_vertices(drag(), LINE, ~ALL_MOVE, reach=0.1)


def test_a_drag_beyond_reach_is_refused_with_distance_and_reach() -> None:
    with pytest.raises(MotionError, match=r"frame 4 hits no vertex: the nearest is 2 m .* allowed are 0.5 m"):
        held_vertices(drag(start=4, point=3.0), LINE, ALL_MOVE, reach=0.5)


def test_a_drag_reaches_as_far_as_it_is_allowed_and_no_farther() -> None:
    at = drag(point=1.25)
    np.testing.assert_array_equal(held_vertices(at, LINE, ALL_MOVE, reach=0.26), [9, 10])
    with pytest.raises(MotionError, match="hits no vertex"):
        held_vertices(at, LINE, ALL_MOVE, reach=0.24)


def test_a_drag_is_active_from_its_start_for_as_many_frames_as_it_has_targets() -> None:
    motion = Motion("two", 8, (drag(1, frames=3), drag(2, frames=4)))
    assert [motion.active(frame) for frame in range(8)] == [(), (0,), (0, 1), (0, 1), (1,), (1,), (), ()]
    assert [each.stop for each in motion.drags] == [4, 6]
    assert motion.active(-1) == motion.active(8) == ()


def test_a_drag_may_last_longer_than_its_motion() -> None:
    motion = Motion("cut", 3, (drag(1, frames=4),))
    assert [motion.active(frame) for frame in range(4)] == [(), (0,), (0,), ()]


def test_the_first_frames_of_a_motion_have_what_begins_within_them() -> None:
    maps = np.tile(np.eye(3, 4), (8, 1, 1))
    motion = Motion("two", 8, (drag(1), drag(3)), np.zeros((8, 3)), (Support(np.array([0]), maps),))
    cut = motion.first(3)
    assert (cut.frames, [each.start for each in cut.drags]) == (3, [1])
    assert cut.gravity is not None and (len(cut.gravity), len(cut.supports[0].maps)) == (3, 3)
    assert (motion.first(4).drags, motion.first(99).frames) == (motion.drags, 8)


@pytest.fixture(scope="module")
def body() -> Scene:
    """A beam 0.5 m long in slices 0.1 m apart, pinned at x = 0."""
    return scene(beam(0.5, 0.1, 0.1, 1))


def slices(body: Scene, vertices: object) -> list[float]:
    """Where along the beam some vertices are, each place once."""
    return np.unique(body.mesh.vertices[vertices, 0].round(6)).tolist()


def test_each_frame_of_a_drag_pulls_to_its_own_target(body: Scene) -> None:
    loads = MotionLoads(Motion("one", 6, (drag(2),)), body)
    targets = [grab.target.tolist() for frame in range(6) for grab in loads.at(frame).grabs]
    assert targets == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    assert loads.at(3).grabs[0].stiffness == 7.0


def test_each_frame_has_its_own_gravity_and_the_place_of_its_pins(body: Scene) -> None:
    gravity, maps = np.arange(9.0).reshape(3, 3), np.arange(36.0).reshape(3, 3, 4)
    pins = np.flatnonzero(body.pinned)
    moving = MotionLoads(Motion("moving", 3, gravity=gravity, supports=(Support(pins, maps),)), body)
    for frame in range(3):
        loads = moving.at(frame)
        assert loads.gravity is not None
        np.testing.assert_array_equal(loads.gravity, gravity[frame])
        ((vertices, placed),) = loads.pins
        np.testing.assert_array_equal(vertices, pins)
        np.testing.assert_array_equal(placed, maps[frame])
    assert MotionLoads(Motion("still", 3), body).at(0) == ((), None, ())


def test_vertices_are_settled_on_the_deformed_solid_when_the_drag_starts_and_kept(body: Scene) -> None:
    loads = MotionLoads(Motion("one", 3, (drag(0),)), body)
    shifted = np.tile([0.3, 0.0, 0.0], (body.mesh.n_vertices, 1))
    assert loads.needs_state(0)
    assert slices(body, loads.at(0, shifted).grabs[0].vertices) == [0.1, 0.2, 0.3]
    assert not loads.needs_state(1)
    assert slices(body, loads.at(1, 0 * shifted).grabs[0].vertices) == [0.1, 0.2, 0.3]


def test_a_drag_of_the_rest_shape_needs_no_state(body: Scene) -> None:
    loads = MotionLoads(Motion("one", 3, (replace(drag(0, 0.32), at_rest=True),)), body)
    assert not loads.needs_state(0)
    shifted = np.tile([0.3, 0.0, 0.0], (body.mesh.n_vertices, 1))
    assert slices(body, loads.at(0, shifted).grabs[0].vertices) == [0.2, 0.3, 0.4]


def test_vertices_settled_before_are_taken_over_on_resuming(body: Scene) -> None:
    loads = MotionLoads(Motion("one", 3, (drag(0),)), body, held={0: np.array([9])})
    assert not loads.needs_state(1)
    np.testing.assert_array_equal(loads.at(1).grabs[0].vertices, [9])
