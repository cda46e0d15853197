"""How far a reduced run is from the snapshots, against plain numpy on the whole."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.dynamics.trajectory import Trajectory
from ldsim.mechanics.motion import Motion
from ldsim.mesh.shapes import beam
from ldsim.pipeline import comparison
from ldsim.pipeline.comparison import Reference, with_errors
from ldsim.space.basis import Basis
from ldsim.space.space import Space
from tests.helpers import scene as scene_of

SCENE = scene_of(beam(length=0.25, resolution=2))
N, VERTICES, K = 11, SCENE.mesh.n_vertices, 5


def a_run(seed: int = 5) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float32]]:
    """A basis, the coordinates of a run, and snapshots that have nothing to do with it."""
    rng = np.random.default_rng(seed)
    full = rng.normal(size=(N, VERTICES, 3)).astype(np.float32)
    return rng.normal(size=(3 * VERTICES, K)), rng.normal(size=(N, K)), full


def judged(
    U: NDArray[np.float64], q: NDArray[np.float64], again: NDArray[np.float64] | None, full: NDArray[np.float32]
) -> Trajectory:
    none = np.zeros(N, dtype=np.int64)

    def run(coordinates: NDArray[np.float64]) -> Trajectory:
        return Trajectory(none, none, none, np.zeros(N), coordinates=coordinates)

    space = Space.linear(SCENE, Basis.of(U, SCENE.mass), K)
    reference = Reference(Motion("any", N), {}, lambda a, b: full[a:b])
    return with_errors(run(q), space, reference, None if again is None else run(again))


@pytest.mark.parametrize("chunk", [1, 4, 5, 100])
def test_the_errors_are_vertex_distances_frame_by_frame_whatever_the_chunks(
    chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(comparison, "CHUNK", chunk)
    U, q, full = a_run()
    result = judged(U, q, 0.5 * q, full)
    distance = np.sqrt((((q @ U.T).reshape(full.shape) - full.astype(np.float64)) ** 2).sum(axis=2))
    again = np.sqrt((((0.5 * q @ U.T).reshape(full.shape) - full.astype(np.float64)) ** 2).sum(axis=2))
    np.testing.assert_allclose(result.mean_error, distance.mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(result.max_error, distance.max(axis=1), rtol=1e-12)
    np.testing.assert_allclose(result.windowed_mean_error, again.mean(axis=1), rtol=1e-12)


def test_a_run_without_a_windowed_one_is_its_own() -> None:
    U, q, full = a_run()
    alone, twice = judged(U, q, None, full), judged(U, q, q, full)
    for name in ("mean_error", "max_error", "windowed_mean_error", "mean_displacement"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(twice, name))


def test_a_run_that_scales_the_motion_is_off_by_that_share_of_its_displacement() -> None:
    U, q, _ = a_run()
    full = (q @ U.T).reshape(N, VERTICES, 3).astype(np.float32)
    result = judged(U, 0.9 * q, q, full)
    assert result.mean_error is not None and result.mean_displacement is not None
    np.testing.assert_allclose(result.mean_error, 0.1 * result.mean_displacement, rtol=1e-5)


def test_a_frame_that_is_lost_is_infinitely_far_and_the_others_are_not() -> None:
    U, q, full = a_run()
    lost = q.copy()
    lost[4] = np.nan
    result = judged(U, lost, q, full)
    assert result.mean_error is not None and result.windowed_mean_error is not None
    assert np.flatnonzero(np.isinf(result.mean_error)).tolist() == [4]
    assert np.isfinite(result.windowed_mean_error).all()
