"""Pins that move and gravity that changes, in the full space: against rigid motions and d'Alembert's principle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.simulate import simulate
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.motion import Drag, Motion, Support
from ldsim.mechanics.recording import read_recording
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from tests.helpers import random_rotation, scene

Array = NDArray[np.float64]


def states(body: Scene, motion: Motion, tolerance: float = 1e-10) -> list[Array]:
    """The displacement after each frame."""
    stepper = FullStepper(body, FullOptions(tolerance=tolerance))
    frames = list(simulate(stepper, motion))
    assert all(frame.solution.converged for frame in frames)
    return [frame.state.u for frame in frames]


def carried(body: Scene, offsets: Array) -> Support:
    """All pins carried along offsets, (frames, 3) metres."""
    maps = np.concatenate([np.broadcast_to(np.eye(3), (len(offsets), 3, 3)), offsets[:, :, None]], axis=2)
    return Support(np.flatnonzero(body.pinned), maps)


@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_pins_that_accelerate_are_felt_as_gravity_the_other_way(cell_type: str) -> None:
    # d'Alembert: seen from pins with sₙ = a h² n(n+1)/2, whose second difference is a h², gravity is g − a.
    mesh = beam(0.4, 0.1, 0.1, 1, cell_type)
    g, a, frames = np.array([0.0, -9.81, 0.0]), np.array([3.0, 4.0, -5.0]), 6
    body = scene(mesh, "neo_hookean", 3e4, gravity=tuple(g))
    steps = np.arange(1, frames + 1)
    offsets = (a * body.time_step**2 / 2) * (steps * (steps + 1))[:, None]
    moving = states(body, Motion("carried", frames, supports=(carried(body, offsets),)))
    felt = states(scene(mesh, "neo_hookean", 3e4, gravity=tuple(g - a)), Motion("still", frames))
    for u, relative, offset in zip(moving, felt, offsets, strict=True):
        np.testing.assert_allclose(u - offset, relative, atol=1e-7)
    assert np.abs(felt[-1]).max() > 1e-3


def test_slowly_turned_pins_turn_the_whole_solid() -> None:
    body = scene(beam(0.4, 0.1, 0.1, 2), gravity=(0.0, 0.0, 0.0), time_step=1e4)
    R, b = random_rotation(np.random.default_rng(3)), np.array([0.1, -0.2, 0.3])
    angle = np.arccos((np.trace(R) - 1) / 2)
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (2 * np.sin(angle))
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    maps = np.empty((20, 3, 4))
    for i, share in enumerate(np.linspace(0.05, 1, 20)):
        maps[i, :, :3] = np.eye(3) + np.sin(share * angle) * cross + (1 - np.cos(share * angle)) * cross @ cross
        maps[i, :, 3] = share * b
    np.testing.assert_allclose(maps[-1, :, :3], R, atol=1e-12)
    motion = Motion("turn", 20, supports=(Support(np.flatnonzero(body.pinned), maps),))
    end = states(body, motion, tolerance=1e-5)[-1]
    np.testing.assert_allclose(end, body.mesh.vertices @ R.T + b - body.mesh.vertices, atol=1e-5)


def test_pins_without_a_path_stand_still_beside_those_with_one() -> None:
    body = scene(beam(0.4, 0.1, 0.1, 1))
    first, *others = np.flatnonzero(body.pinned)
    lifted = np.tile(np.hstack([np.eye(3), [[0.0], [0.0], [0.004]]]), (2, 1, 1))
    u = states(body, Motion("one", 2, supports=(Support(np.array([first]), lifted),)))[-1]
    np.testing.assert_allclose(u[first], [0, 0, 0.004], atol=1e-15)
    assert not u[others].any()


def test_gravity_of_a_motion_takes_the_place_of_the_scene_s() -> None:
    mesh = beam(0.4, 0.1, 0.1, 1)
    track = np.array([[0.0, -9.81, 0.0], [0.0, 0.0, 0.0], [4.0, 0.0, -2.0], [0.0, 9.0, 1.0]])
    given = states(scene(mesh, gravity=(7.0, 7.0, 7.0)), Motion("turning", 4, gravity=track))
    state = FullStepper(scene(mesh)).rest()
    for g, u in zip(track, given, strict=True):
        state, _ = FullStepper(scene(mesh, gravity=tuple(g)), FullOptions(tolerance=1e-10)).step(state, Loads())
        np.testing.assert_allclose(u, state.u, atol=1e-9)


def test_the_first_frames_of_a_motion_are_those_of_the_whole() -> None:
    body = scene(beam(0.4, 0.1, 0.1, 1))
    gravity = np.random.default_rng(0).normal(size=(5, 3))
    drags = tuple(Drag(start, np.array([0.4, 0, 0]), np.ones((2, 3)), 0.05, 10.0) for start in (0, 3))
    whole = Motion("m", 5, drags, gravity, (carried(body, gravity / 1e3),))
    part = whole.first(2)
    assert (part.frames, len(part.drags), len(part.gravity)) == (2, 1, 2)  # type: ignore[arg-type]
    for u, v in zip(states(body, part), states(body, whole), strict=False):
        np.testing.assert_array_equal(u, v)
    assert whole.first(9).frames == 5


def test_a_recording_made_on_a_coarse_mesh_moves_a_fine_one_alike(tmp_path: Path) -> None:
    # Figure 8 of the paper: what pulls on the fine mesh is the recording alone, found again by its points
    rows = ["# spring_stiffness_n_per_m: 200", "# grab_radius_m: 0.06"]
    rows.append("is_dragging,target_x,target_y,target_z,grabbed_x,grabbed_y,grabbed_z")
    rows += [f"{int(i < 15)},{0.4 - 0.002 * i},{0.006 * i},{0.003 * i},0.4,0,0" for i in range(25)]
    (tmp_path / "coarse.csv").write_text("\n".join(rows), encoding="utf-8")
    motion = read_recording(tmp_path / "coarse.csv", "coarse")
    tips = []
    for resolution in (2, 4):
        body = scene(beam(0.4, 0.1, 0.1, resolution, "hex8"), "neo_hookean", gravity=(0.0, 0.0, 0.0))
        tip = body.mesh.vertices[:, 0] > 0.4 - 1e-9
        tips.append(np.array([u[tip].mean(axis=0) for u in states(body, motion, tolerance=1e-6)]))
    coarse, fine = tips
    assert np.abs(fine).max() > 0.03
    assert np.linalg.norm(coarse - fine) < 0.1 * np.linalg.norm(fine)
