"""Tangents and forces at poses: derivatives of the projected force, however the poses are streamed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldsim.learn.examples import PoseForces, Poses, pose_forces, spread_numbers
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


REST = np.zeros((BODY.mesh.n_vertices, 3))


def poses_of(u: NDArray[np.floating], prescribed: Array = REST) -> Poses:
    """Poses that are u and what is prescribed together."""
    fields = u.reshape(-1, *REST.shape).astype(np.float64)
    return Poses(BASIS.project(u), lambda i: fields[i] + prescribed, lambda _: prescribed)


def found(poses: NDArray[np.floating] = POSES) -> tuple[PoseForces, Array]:
    given, calls = poses_of(poses), list[None]()
    forces = pose_forces(BODY, BASIS, given, 5, lambda: calls.append(None))
    assert len(calls) == 5
    return forces, given.q


def test_the_tangent_is_the_derivative_of_the_projected_force() -> None:
    # At strains of some millionths no point's tangent has a negative eigenvalue to speak of, and clamping does nothing.
    poses = np.float32(1e-3) * POSES
    forces, _ = found(poses)
    direction, h = np.array([0.3, -1.0, 0.5, 0.2]), 1e-7
    for frame, stiffness in zip(forces.frames, forces.stiffness, strict=True):
        u = poses[frame].astype(np.float64)
        slope = U.T @ (force(u + h * U @ direction) - force(u - h * U @ direction)) / (2 * h)
        np.testing.assert_allclose(stiffness @ direction, slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())


def test_the_excess_is_what_projection_adds_to_the_force() -> None:
    forces, q = found()
    for frame, excess in zip(forces.frames, forces.excess, strict=True):
        added = U.T @ (force(U @ q[frame]) - force(POSES[frame].astype(np.float64)))
        np.testing.assert_allclose(excess, added, rtol=1e-9, atol=1e-9 * np.abs(added).max())


def test_what_moving_pins_prescribe_is_no_error_of_the_projection() -> None:
    prescribed = 1e-5 * np.random.default_rng(4).normal(size=REST.shape) * BODY.pinned[:, None]
    forces = pose_forces(BODY, BASIS, poses_of(POSES, prescribed), 5, lambda: None)
    for frame, excess in zip(forces.frames, forces.excess, strict=True):
        projected = prescribed.ravel() + U @ BASIS.project(POSES[[frame]])[0]
        added = U.T @ (force(projected) - force(prescribed.ravel() + POSES[frame].astype(np.float64)))
        np.testing.assert_allclose(excess, added, rtol=1e-9, atol=1e-9 * np.abs(added).max())


def test_poses_of_the_basis_have_no_excess() -> None:
    q = np.random.default_rng(3).normal(size=(20, 4)) * np.abs(BASIS.project(POSES)).max()
    forces = pose_forces(BODY, BASIS, poses_of(BASIS.displacement(q)), 7, lambda: None)
    np.testing.assert_array_equal(forces.frames, spread_numbers(20, 7))
    assert np.abs(forces.excess).max() < 1e-9 * np.abs(found()[0].excess).max()


def test_numbers_are_spread_over_all() -> None:
    np.testing.assert_array_equal(spread_numbers(9, 5), [0, 2, 4, 6, 8])
    np.testing.assert_array_equal(spread_numbers(3, 5), [0, 1, 2])
