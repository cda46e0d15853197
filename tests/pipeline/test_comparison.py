"""Comparisons: a space that holds every motion has no error, restarts take effect, lost runs are shown."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullState, FullStepper, run
from ldsim.dynamics.reduced.stepper import ReducedState, ReducedStepper
from ldsim.errors import MotionError
from ldsim.mechanics.loads import MotionLoads
from ldsim.mechanics.motion import Drag, Motion, Support
from ldsim.mechanics.properties import Change
from ldsim.mechanics.scene import Scene, properties_of, with_properties
from ldsim.mesh.shapes import beam
from ldsim.optimise.solution import Reason
from ldsim.pipeline.comparison import Options, ReducedSpace, compare_motion, run_reduced, stretch
from ldsim.space.basis import inner_product
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.pca import orthonormalised
from tests.helpers import scene

Array = NDArray[np.float64]

BODY = scene(beam(resolution=1), youngs_modulus=3e4)
TIP = BODY.mesh.vertices[BODY.mesh.vertices[:, 0].argmax()]
PULL = Drag(3, TIP, np.tile(TIP + [0, 0.04, 0], (6, 1)), 0.02, 30.0)
MOTION = Motion("pull", 14, (PULL,))
OPTIONS = Options(tolerance=1e-9, max_iterations=300, full_frames=5, window=0.05)


def basis(columns: int | None = None) -> Array:
    unit = np.zeros((3 * BODY.mesh.n_vertices, 3 * len(BODY.free)))
    rows = (3 * BODY.free[:, None] + np.arange(3)).ravel()
    unit[rows, np.arange(len(rows))] = 1
    return np.ascontiguousarray(orthonormalised(unit, inner_product(BODY.mass, "mass")).matrix[:, :columns])


@pytest.fixture(scope="module")
def snapshots() -> tuple[NDArray[np.float32], dict[int, NDArray[np.int64]]]:
    return recorded(MOTION)


def recorded(motion: Motion) -> tuple[NDArray[np.float32], dict[int, NDArray[np.int64]]]:
    tracker = GrabTracker(motion, BODY.mesh.vertices, BODY.movable)
    stepper = FullStepper(BODY, FullOptions(tolerance=1e-9))
    frames = run(stepper, tracker, FullState.at_rest(BODY.mesh.n_vertices), range(motion.frames))
    return np.array([state.u for _, state, _ in frames], dtype=np.float32), tracker.held


def whole(U: Array) -> ReducedSpace:
    points = CubatureRule(np.arange(BODY.points.n_points), BODY.points.weights, 0.0)
    return ReducedSpace("linear", U, Decoder.identity(U.shape[1]), Encoder((), ()), points)


def compared(body: Scene, space: ReducedSpace, snapshots: object, motion: Motion = MOTION) -> dict[str, object]:
    fields, held = snapshots  # type: ignore[misc]
    metric = inner_product(body.mass, "mass")
    runs = compare_motion(body, metric, [space], motion, held, lambda a, b: fields[a:b], OPTIONS, lambda: None)
    return {name: trajectory for name, trajectory, _ in runs}


def test_a_space_that_holds_every_motion_has_no_error(snapshots: object) -> None:
    runs = compared(BODY, whole(basis()), snapshots)
    linear = runs["linear"]
    assert linear.max_error.max() < 1e-6  # type: ignore[attr-defined]
    assert linear.windowed_mean_error.max() < 1e-6  # type: ignore[attr-defined]
    assert not linear.diverged  # type: ignore[attr-defined]


def test_restarts_from_the_full_space_lower_the_error_of_a_poor_space(snapshots: object) -> None:
    linear = compared(BODY, whole(basis(20)), snapshots)["linear"]
    assert linear.windowed_mean_error.sum() < linear.mean_error.sum()  # type: ignore[attr-defined]


def test_the_full_space_is_timed_from_the_first_grab_on(snapshots: object) -> None:
    full = compared(BODY, whole(basis(20)), snapshots)["full"]
    assert len(full.seconds) == OPTIONS.full_frames  # type: ignore[attr-defined]
    assert stretch(MOTION, 5) == range(3, 8)
    assert stretch(MOTION, 100) == range(14)


def test_with_another_material_the_spaces_run_it_and_nothing_is_judged(snapshots: object) -> None:
    _, held = snapshots  # type: ignore[misc]
    softer = with_properties(BODY, properties_of(BODY).changed(Change(youngs_factor=0.5)))
    metric, U = inner_product(BODY.mass, "mass"), basis()
    found = compare_motion(softer, metric, [whole(U)], MOTION, held, None, OPTIONS, lambda: None)
    runs = {name: trajectory for name, trajectory, _ in found}
    assert len(runs["full"].seconds) == OPTIONS.full_frames
    linear = runs["linear"]
    assert linear.mean_error is None and linear.windowed_mean_error is None and linear.coordinates is not None
    tracker = GrabTracker(MOTION, BODY.mesh.vertices, BODY.movable, dict(held))
    alone = run(
        FullStepper(softer, FullOptions(tolerance=1e-9)), tracker, FullState.at_rest(BODY.mesh.n_vertices), range(14)
    )
    for (_, state, _), q in zip(alone, linear.coordinates, strict=True):
        np.testing.assert_allclose((U @ q).reshape(-1, 3), state.u, atol=1e-7)


def test_a_space_that_holds_every_motion_relative_to_pins_that_move_has_no_error() -> None:
    maps = np.tile(np.eye(3, 4), (14, 1, 1))
    maps[:, 2, 3] = 0.02 * np.sin(np.linspace(0, 4, 14))
    maps[:, 1, 0] = 0.3 * np.sin(np.linspace(0, 3, 14))
    shaken = Motion("shaken", 14, (PULL,), supports=(Support(np.flatnonzero(BODY.pinned), maps),))
    run = recorded(shaken)
    linear = compared(BODY, whole(basis()), run, shaken)["linear"]
    assert linear.max_error.max() < 1e-6  # type: ignore[attr-defined]
    assert linear.windowed_mean_error.max() < 1e-6  # type: ignore[attr-defined]
    moved = np.linalg.norm(run[0].astype(float), axis=2).mean(axis=1)
    np.testing.assert_allclose(linear.mean_displacement, moved)  # type: ignore[attr-defined]


def test_pins_that_a_stepper_was_not_prepared_for_are_refused_and_the_motion_named() -> None:
    support = Support(np.flatnonzero(BODY.pinned), np.tile(np.eye(3, 4), (2, 1, 1)))
    U, every = basis(4), CubatureRule.every(BODY)
    stepper = ReducedStepper(BODY, U, Decoder.identity(4), every)
    with pytest.raises(MotionError, match="motion twist moves pins, for which this space was not prepared"):
        run_reduced(stepper, BODY, Motion("twist", 2, supports=(support,)), {}, range(2))


def test_a_lost_run_ends_in_nan_and_counts_as_diverged() -> None:
    U = basis()
    every = CubatureRule.every(BODY)
    stepper = ReducedStepper(BODY, U, Decoder.identity(U.shape[1]), every)
    inverted = -2 * BODY.mesh.vertices
    inverted[BODY.pinned] = 0
    q = U.T @ (BODY.mass @ inverted).ravel()
    lost = run_reduced(stepper, BODY, MOTION, {}, range(3), start=ReducedState.moving(q, q, q, q))
    assert lost.diverged
    assert np.isnan(lost.coordinates).all()
    assert (lost.reason == Reason.INFINITE_START).all()
