"""Pulls like those of other motions, anywhere on the solid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldsim.errors import SceneError
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.options import PullOptions
from ldsim.mechanics.random_pulls import FARTHER, covering_pulls, pulls_like, surface_pulls
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.mesh.surface import surface_vertices
from tests.helpers import scene

SOLID = scene(beam(0.4, 0.05, 0.05, 2), gravity=(0.0, -9.8, 0.0))


def motion_of(solid: Scene) -> Motion:
    return surface_pulls("a", solid, PullOptions(count=4, reach=0.3, stiffness=7.0, radius=0.05, frames=11, rest=2))


def test_they_are_as_stiff_and_wide_and_long_as_those_given_and_go_farther() -> None:
    given = motion_of(SOLID)
    found = covering_pulls("b", SOLID, [given], 10, seed=1)
    assert len(found.drags) == 10 and found.frames == 10 * 22
    assert {(drag.stiffness, drag.radius, len(drag.targets)) for drag in found.drags} == {(7.0, 0.05, 11)}
    reach = max(np.linalg.norm(drag.targets - drag.targets[0], axis=1).max() for drag in given.drags)
    lengths = [np.linalg.norm(drag.targets[-1] - drag.point) for drag in found.drags]
    assert reach < max(lengths) <= FARTHER * reach * (1 + 1e-12)


def test_pulls_like_some_go_as_far_as_these() -> None:
    given = motion_of(SOLID)
    found = pulls_like([Motion("still", 5), given], 10, seed=1)
    assert found is not None and (found.count, found.seed, found.stiffness, found.radius) == (10, 1, 7.0, 0.05)
    assert (found.frames, found.rest) == (11, 11)
    assert found.reach == max(np.linalg.norm(drag.targets - drag.targets[0], axis=1).max() for drag in given.drags)


def test_like_what_is_only_held_are_pulls_as_long_as_they_are_wide() -> None:
    held = Motion("held", 5, (Drag(0, np.zeros(3), np.zeros((5, 3)), 0.02, 3.0),))
    found = pulls_like([held], 1, seed=0)
    assert found is not None and (found.reach, found.frames) == (0.02, 5)


def test_nothing_is_like_pulls_that_there_are_not() -> None:
    assert pulls_like([Motion("still", 5)], 10, seed=1) is None


def test_every_other_has_the_gravity_of_the_scene_and_the_rest_as_much_in_other_directions() -> None:
    found = covering_pulls("b", SOLID, [motion_of(SOLID)], 10, seed=1)
    assert found.gravity is not None
    of_each = found.gravity.reshape(10, 22, 3)
    np.testing.assert_array_equal(of_each, np.broadcast_to(of_each[:, :1], of_each.shape))
    np.testing.assert_array_equal(of_each[::2, 0], np.tile(SOLID.gravity, (5, 1)))
    np.testing.assert_allclose(np.linalg.norm(of_each[1::2, 0], axis=1), 9.8)
    assert np.ptp(of_each[1::2, 0], axis=0).min() > 5.0


def test_a_solid_that_nothing_pulls_has_turned_gravity_alone() -> None:
    found = covering_pulls("b", SOLID, [Motion("still", 5)], 4, seed=1)
    assert not found.drags and found.gravity is not None and found.frames == len(found.gravity)


def test_gravity_is_as_strong_as_it_was_in_the_motions() -> None:
    sweep = Motion("sweep", 3, gravity=np.array([[0.0, -5.0, 0.0], [0.0, 0.0, 20.0], [1.0, 0.0, 0.0]]))
    found = covering_pulls("b", replace(SOLID, gravity=np.zeros(3)), [sweep, Motion("still", 5)], 4, seed=1)
    assert found.gravity is not None and np.linalg.norm(found.gravity, axis=1).max() == pytest.approx(20.0)


def test_a_solid_whose_pins_hold_all_of_its_surface_cannot_be_pulled() -> None:
    pinned = np.isin(np.arange(SOLID.mesh.n_vertices), surface_vertices(SOLID.mesh))
    inside = replace(SOLID, pinned=pinned)
    assert len(inside.free)
    with pytest.raises(SceneError, match=r"no vertex of the surface can move; .* \(mesh\.pins\)") as error:
        motion_of(inside)
    assert "\n" not in str(error.value)
