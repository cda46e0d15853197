"""The automatic view: upright, and from where the solid is broad."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.mesh.shapes import beam, cross
from ldsim.report.camera import look_at_broadside, screen_positions, upright

EXTENTS = np.array([0.3, 0.2, 0.05])


def box(extents: np.ndarray) -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.5, 0.5, (500, 3)) * extents


@pytest.mark.parametrize("gravity", [(0, -9.8, 0), (0, 9.8, 0), (0, 0, -9.8), (3, 0, 0), (1, -2, 3), (0, 5, 1e-7)])
def test_gravity_is_turned_down_by_a_rotation(gravity):
    R = upright(np.array(gravity, dtype=float))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)
    np.testing.assert_allclose(R @ gravity, [0, -np.linalg.norm(gravity), 0], atol=1e-6)


def test_without_gravity_nothing_turns():
    np.testing.assert_array_equal(upright(np.zeros(3)), np.eye(3))


@pytest.mark.parametrize("degrees", range(0, 180, 20))
def test_a_thin_solid_is_seen_broadside_however_it_stands(degrees):
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    rest = box(EXTENTS) @ turn.T
    screen = screen_positions(look_at_broadside(rest, rest), rest)
    width, height, depth = np.ptp(screen, axis=0)
    assert width > 0.85 * EXTENTS[0] and height > 0.85 * EXTENTS[1]
    assert depth < 0.75 * width


@pytest.mark.parametrize("mesh", [beam(), cross()], ids=["beam", "cross"])
def test_the_long_sides_of_beam_and_cross_lie_across_the_screen(mesh):
    screen = screen_positions(look_at_broadside(mesh.vertices, mesh.vertices), mesh.vertices)
    assert np.ptp(screen[:, 0]) > 0.9 * np.ptp(mesh.vertices[:, 0])


def test_a_flat_solid_is_seen_from_higher_up():
    plate, block = box(np.array([0.3, 0.02, 0.2])), box(np.array([0.3, 0.2, 0.2]))
    assert look_at_broadside(plate, plate).elevation > look_at_broadside(block, block).elevation
