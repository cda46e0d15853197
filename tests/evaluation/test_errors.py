"""Errors between runs against plain numpy, and chunks against the whole."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.evaluation.errors import (
    ErrorAccumulator,
    ErrorSummary,
    OnlineError,
    OnlineErrorAccumulator,
    error_summary,
    online_error,
    vertex_distances,
)


def two_runs(frames: int = 11, vertices: int = 7) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    return rng.normal(size=(frames, vertices, 3)), rng.normal(size=(frames, vertices, 3))


def test_a_three_four_five_triangle_is_five_away():
    a = np.zeros((1, 2, 3))
    b = a.copy()
    b[0, 1] = [0.0, 3.0, 4.0]
    assert vertex_distances(a, b).tolist() == [[0.0, 5.0]]


def test_summary_is_the_maximum_and_mean_over_vertices_in_millimetres():
    a, b = two_runs()
    distances = np.sqrt(((a - b) ** 2).sum(axis=2))
    summary = error_summary(a, b)
    assert summary.max_mm == pytest.approx(1000 * distances.max(), rel=1e-14)
    assert summary.mean_mm == pytest.approx(1000 * distances.mean(), rel=1e-14)


def test_a_rigid_offset_is_its_length_at_every_vertex():
    a, _ = two_runs()
    assert error_summary(a + [0.002, 0, 0], a) == ErrorSummary(pytest.approx(2.0), pytest.approx(2.0))


def test_a_run_that_scales_the_motion_is_relatively_off_by_that_much():
    full, _ = two_runs()
    assert online_error(0.9 * full, full).relative == pytest.approx(0.1, rel=1e-12)


def test_online_error_is_mean_distance_over_mean_displacement():
    reduced, full = two_runs()
    per_frame = np.linalg.norm(reduced - full, axis=2).mean(axis=1)
    expected = per_frame.mean() / np.linalg.norm(full, axis=2).mean()
    error = online_error(reduced, full)
    assert error.relative == pytest.approx(expected, rel=1e-13)
    assert error.mean_mm == pytest.approx(1000 * per_frame.mean(), rel=1e-13)


@pytest.mark.parametrize("cuts", [[], [1], [3, 4, 9], [0, 11]])
def test_chunks_add_up_to_the_whole(cuts):
    reduced, full = two_runs()
    accumulator = OnlineErrorAccumulator()
    curve = [
        accumulator.add(a, b) for a, b in zip(np.split(reduced, cuts), np.split(full, cuts), strict=True) if len(a)
    ]
    whole, chunked = online_error(reduced, full), accumulator.result()
    for name in ("relative", "max_mm", "mean_mm"):
        assert getattr(chunked, name) == pytest.approx(getattr(whole, name), rel=1e-13)
    per_frame_mm = 1000 * np.linalg.norm(reduced - full, axis=2).mean(axis=1)
    np.testing.assert_allclose(np.concatenate(curve), per_frame_mm, rtol=1e-13)


def test_chunks_of_unequal_length_weigh_by_their_frames():
    accumulator = ErrorAccumulator()
    accumulator.add(np.full((3, 2), 0.001))
    accumulator.add(np.full((1, 2), 0.005))
    accumulator.add(np.empty((0, 2)))
    assert accumulator.summary() == ErrorSummary(pytest.approx(5.0), pytest.approx(2.0))


def test_a_motion_that_never_moves_has_no_relative_error():
    still = np.zeros((2, 3, 3))
    assert online_error(still + 1e-3, still) == OnlineError(None, pytest.approx(np.sqrt(3)), pytest.approx(np.sqrt(3)))


def test_a_run_that_blew_up_is_infinitely_far():
    a, b = two_runs()
    a[4, 2, 1] = np.nan
    assert online_error(a, b).max_mm == np.inf


def test_single_precision_is_widened_before_the_difference():
    a = np.full((1, 1, 3), 1.0, dtype=np.float32)
    b = np.full((1, 1, 3), 1.0 + 1e-12)
    assert vertex_distances(a, b)[0, 0] == pytest.approx(np.sqrt(3) * 1e-12, rel=1e-3)


@pytest.mark.parametrize("shapes", [((2, 3, 3), (2, 4, 3)), ((3, 3), (3, 3)), ((2, 3, 2), (2, 3, 2))])
def test_shapes_that_are_not_poses_are_refused(shapes):
    a, b = (np.zeros(shape) for shape in shapes)
    with pytest.raises(ValueError, match="expected twice the same"):
        vertex_distances(a, b)


def test_an_error_of_nothing_is_refused():
    with pytest.raises(ValueError, match="no poses"):
        ErrorAccumulator().summary()
