"""Tangents and forces at poses: derivatives of the projected force, however the poses are streamed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldsim.learn.equilibrium import Poses, pose_forces, spread_forces, spread_frames
from ldsim.learn.examples import PoseForces
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mesh.shapes import beam
from ldsim.space.pca import orthonormalised
from tests.helpers import scene

Array = NDArray[np.float64]

BODY = scene(beam(resolution=2))
FREE = np.repeat(BODY.movable, 3)
BASIS = orthonormalised(np.random.default_rng(0).normal(size=(3 * BODY.mesh.n_vertices, 4)) * FREE[:, None], BODY.mass)
U = BASIS.matrix
# Not all in the basis.
POSES = (np.random.default_rng(1).normal(size=(11, len(FREE))) * 1e-5 * FREE).astype(np.float32)


def force(u: Array) -> Array:
    gradient = np.zeros((BODY.mesh.n_vertices, 3))
    add_elastic_gradient(BODY.elements, u.reshape(-1, 3), gradient)
    return gradient.ravel()


def found(size: int, poses: NDArray[np.float32] = POSES) -> tuple[PoseForces, Array]:
    q = BASIS.project(poses)
    calls: list[None] = []
    pieces = [poses[start : start + size] for start in range(0, len(POSES), size)]
    streamed = Poses(q, lambda: pieces)
    forces = pose_forces(BODY, BASIS, streamed, spread_frames(len(POSES), 5), lambda: calls.append(None))
    assert len(calls) == 5
    return forces, q


def test_the_tangent_is_the_derivative_of_the_projected_force() -> None:
    # At strains of some millionths no point's tangent has a negative eigenvalue to speak of, and clamping does nothing.
    poses = np.float32(1e-3) * POSES
    forces, _ = found(4, poses)
    direction, h = np.array([0.3, -1.0, 0.5, 0.2]), 1e-7
    for frame, stiffness in zip(forces.frames, forces.stiffness, strict=True):
        u = poses[frame].astype(np.float64)
        slope = U.T @ (force(u + h * U @ direction) - force(u - h * U @ direction)) / (2 * h)
        np.testing.assert_allclose(stiffness @ direction, slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())


def test_the_excess_is_what_projection_adds_to_the_force() -> None:
    forces, q = found(4)
    for frame, excess in zip(forces.frames, forces.excess, strict=True):
        added = U.T @ (force(U @ q[frame]) - force(POSES[frame].astype(np.float64)))
        np.testing.assert_allclose(excess, added, rtol=1e-9, atol=1e-9 * np.abs(added).max())


def test_chunks_of_any_size_give_the_same() -> None:
    whole, pieces = found(len(POSES))[0], found(3)[0]
    np.testing.assert_array_equal(whole.stiffness, pieces.stiffness)
    np.testing.assert_array_equal(whole.excess, pieces.excess)


def test_synthetic_poses_come_after_the_snapshots_and_have_no_excess() -> None:
    q = BASIS.project(POSES)
    synthetic = np.random.default_rng(3).normal(size=(20, 4)) * np.abs(q).max()
    calls: list[None] = []
    recordings = Poses(q, lambda: [POSES])
    forces = spread_forces(BODY, BASIS, recordings, synthetic, 7, lambda: calls.append(None))
    np.testing.assert_array_equal(forces.frames, spread_frames(len(q) + 20, 7))
    assert len(calls) == 7
    recorded = forces.frames < len(q)
    assert 0 < recorded.sum() < 7
    alone = pose_forces(BODY, BASIS, recordings, forces.frames[recorded], lambda: None)
    np.testing.assert_array_equal(forces.stiffness[recorded], alone.stiffness)
    np.testing.assert_array_equal(forces.excess[recorded], alone.excess)
    assert np.abs(forces.excess[~recorded]).max() < 1e-9 * np.abs(forces.excess[recorded]).max()
    for frame, stiffness in zip(forces.frames[~recorded], forces.stiffness[~recorded], strict=True):
        own = synthetic[[frame - len(q)]]
        pose = Poses(own, lambda own=own: [BASIS.displacement(own[0])[None]])
        there = pose_forces(BODY, BASIS, pose, np.array([0]), lambda: None)
        np.testing.assert_array_equal(stiffness, there.stiffness[0])
