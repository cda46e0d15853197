"""Pins that move in a reduced space: the weights of their lifting, and what it makes of displacements."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.errors import MotionError
from ldsim.mechanics.motion import Motion, Support
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.space.lifting import Lifting, harmonic_weights
from tests.helpers import random_rotation, scene

Array = NDArray[np.float64]


def clamped_at_both_ends(cell_type: str = "tet4") -> tuple[Scene, NDArray[np.int64], NDArray[np.int64]]:
    mesh = beam(0.4, 0.1, 0.1, 2, cell_type)
    x = mesh.vertices[:, 0]
    left, right = np.flatnonzero(x == x.min()), np.flatnonzero(x == x.max())
    body = scene(mesh)
    pinned = np.zeros(mesh.n_vertices, dtype=bool)
    pinned[left] = pinned[right] = True
    return (
        Scene(mesh, body.material, body.mu, body.lam, body.density, pinned, body.gravity, body.time_step),
        left,
        right,
    )


def paths(seed: int, frames: int = 4) -> Array:
    """(A | b) of each frame, any affine maps."""
    return np.eye(3, 4) + 0.3 * np.random.default_rng(seed).normal(size=(frames, 3, 4))


@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_the_weight_of_one_end_of_a_beam_falls_evenly_to_the_other(cell_type: str) -> None:
    body, left, right = clamped_at_both_ends(cell_type)
    x = body.mesh.vertices[:, 0]
    share = (x - x.min()) / np.ptp(x)
    for weight, expected in zip(harmonic_weights(body, [right, left]), (share, 1 - share), strict=True):
        np.testing.assert_allclose(weight, expected, atol=1e-9)


def test_pins_follow_their_paths_and_those_without_one_stand_still() -> None:
    body, left, right = clamped_at_both_ends()
    both = Motion("both", 4, supports=(Support(left, paths(1)), Support(right, paths(2))))
    one = Motion("one", 4, supports=(Support(right, paths(3)),))
    lifting = Lifting.of(body, [both, one])
    assert lifting.count == 24
    for motion in (both, one):
        lifted = lifting.displacements(motion)(0, 4)
        expected = np.zeros((4, body.mesh.n_vertices, 3))
        for support in motion.supports:
            for frame in range(4):
                moved = MovedPins(support.vertices, support.maps[frame])
                expected[frame, support.vertices] = moved.displacement(body.mesh.vertices)
        np.testing.assert_allclose(lifted[:, body.pinned], expected[:, body.pinned], atol=1e-14)


def test_the_coordinates_of_a_motion_are_those_of_its_pins_frame_by_frame() -> None:
    body, left, right = clamped_at_both_ends()
    both = Motion("both", 4, supports=(Support(left, paths(1)), Support(right, paths(2))))
    lifting = Lifting.of(body, [both])
    for frame, a in enumerate(lifting.coordinates(both)):
        pins = [MovedPins(support.vertices, support.maps[frame]) for support in both.supports]
        np.testing.assert_array_equal(lifting.at(pins), a)
        np.testing.assert_array_equal(lifting.at(pins[::-1]), a)
        np.testing.assert_array_equal(lifting.at(pins[:1]), np.where(np.arange(24) < 12, a, 0.0))
    assert not lifting.at([]).any()


def test_pins_that_all_move_as_one_rigid_body_carry_the_whole_solid() -> None:
    body, left, right = clamped_at_both_ends()
    R, b = random_rotation(np.random.default_rng(3)), np.array([0.1, -0.2, 0.3])
    maps = np.hstack([R, b[:, None]])[None]
    motion = Motion("carried", 1, supports=(Support(left, maps), Support(right, maps)))
    X = body.mesh.vertices
    lifted = Lifting.of(body, [motion]).displacements(motion)(0, 1)[0]
    np.testing.assert_allclose(lifted, X @ R.T + b - X, atol=1e-9)


def test_what_is_left_of_snapshots_is_zero_at_the_pins_and_whole_with_what_was_taken_off() -> None:
    body, left, right = clamped_at_both_ends()
    still = Motion("still", 3)
    moving = Motion("moving", 4, supports=(Support(right, paths(2)),))
    lifting, n = Lifting.of(body, [still, moving]), body.mesh.n_vertices
    rng = np.random.default_rng(0)
    rest = rng.normal(size=(7, n, 3))
    rest[:, body.pinned] = 0
    u = rest + np.concatenate([np.zeros((3, n, 3)), lifting.displacements(moving)(0, 4)])
    rows = u.reshape(7, -1).astype(np.float32)
    found = np.concatenate(list(lifting.taken_off(lambda: iter([rows[:2], rows[2:6], rows[6:]]), [still, moving])()))
    np.testing.assert_allclose(found.reshape(7, n, 3), rest, atol=1e-6)
    assert not found.reshape(7, n, 3)[:, body.pinned].any()


def test_pins_that_it_was_not_made_for_are_refused() -> None:
    body, left, right = clamped_at_both_ends()
    twist = Motion("twist", 4, supports=(Support(left, paths(1)),))
    other = Motion("other", 4, supports=(Support(right, paths(1)),))
    message = f"{len(right)} pins move, the first at vertex {right[0]}; this space was not prepared for them"
    with pytest.raises(MotionError, match=message):
        Lifting.of(body, [twist]).coordinates(other)
    with pytest.raises(MotionError, match=message):
        Lifting.of(body, [twist]).at([MovedPins(right, paths(1)[0])])
    nothing = Lifting.of(body, [Motion("still", 4)])
    assert nothing.fields.shape == (3 * body.mesh.n_vertices, 0) and nothing.coordinates(Motion("still", 4)).size == 0
