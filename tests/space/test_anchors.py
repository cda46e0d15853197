"""Compliance kept at anchors: exact where there are enough of them, and as far off as it says where there are few."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.mechanics.grabs import usual_grip
from ldsim.mesh.shapes import beam
from ldsim.space.anchors import Anchors, interpolation, interpolator
from ldsim.space.basis import Basis
from ldsim.space.relaxation import Relaxation
from tests.helpers import scene, smooth_basis


@pytest.fixture(scope="module")
def relaxation() -> Relaxation:
    body = scene(beam(resolution=3))
    return Relaxation(body, Basis.of(smooth_basis(body, 4), body.mass))


def test_where_no_vertex_is_left_out_nothing_is_approximated(relaxation: Relaxation) -> None:
    anchors = Anchors.of(relaxation.scene, relaxation.residual)
    force = np.random.default_rng(0).normal(size=relaxation.scene.mesh.vertices.shape)
    exact = relaxation.residual(force)
    np.testing.assert_allclose(anchors.residual(force), exact, atol=1e-12 * np.abs(exact).max())
    assert anchors.error(relaxation.scene, relaxation.residual)[1] < 1e-12


def test_affine_fields_are_carried_as_they_are_and_pins_stand_still(relaxation: Relaxation) -> None:
    solid = relaxation.scene
    chosen, near, weights = interpolation(solid, 60)
    assert near.shape[1] > 1 and not weights[solid.pinned].any() and solid.movable[chosen].all()
    x, P = solid.mesh.vertices, interpolator(near, weights)
    away = (x[:, 0] - x[:, 0].min())[:, None] * [1.0, -2.0, 0.5]  # zero at the pins, so pinned anchors say so
    np.testing.assert_allclose(P @ away[chosen], away, atol=1e-6 * solid.mesh.diagonal)
    far = x[:, 0] > np.median(x[:, 0])  # nearer to the pins some anchors are pinned
    np.testing.assert_allclose((P @ np.ones(len(chosen)))[far], 1.0, atol=1e-6)
    np.testing.assert_allclose((P @ x[chosen])[far], x[far], atol=1e-6 * solid.mesh.diagonal)


def test_kept_at_few_anchors_it_is_symmetric_positive_and_off_by_what_it_says(relaxation: Relaxation) -> None:
    few, more = (Anchors.of(relaxation.scene, relaxation.residual, count) for count in (30, 90))
    for anchors in (few, more):
        np.testing.assert_array_equal(anchors.matrix, anchors.matrix.T)
        assert np.linalg.eigvalsh(anchors.matrix).min() > -1e-9 * np.abs(anchors.matrix).max()
    assert (
        0
        < more.error(relaxation.scene, relaxation.residual)[0]
        < few.error(relaxation.scene, relaxation.residual)[0]
        < 0.5
    )
    solid = relaxation.scene
    x, radius = solid.mesh.vertices, usual_grip(solid)[1]
    held = np.flatnonzero(np.linalg.norm(x - x[x[:, 0].argmax()], axis=1) <= radius)
    force = np.zeros_like(x)
    force[held, 1] = 1 / len(held)
    exact, kept = (each.residual(force)[held, 1].mean() for each in (relaxation, more))
    assert abs(kept - exact) <= 2 * more.error(relaxation.scene, relaxation.residual)[1] * exact
