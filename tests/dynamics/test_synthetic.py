"""Synthetic motions: one run in the linear space ends where the full space does, and a lost run keeps what it had."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import eye_array, kron

from ldsim.cubature.choose import drawn_candidates
from ldsim.cubature.options import FitOptions
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.dynamics.synthetic import synthetic_frames, synthetic_stepper
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.options import PullOptions
from ldsim.mechanics.random_pulls import random_pulls
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.space.basis import Basis
from tests.helpers import scene

Array = NDArray[np.float64]
K = 14


@pytest.fixture(scope="module")
def body() -> Scene:
    return scene(beam(0.4, 0.1, 0.1, 2), "neo_hookean", 1e5, gravity=(0.0, -9.8, 0.0), time_step=0.01)


def pulled(body: Scene, seed: int) -> Motion:
    options = PullOptions(count=3, seed=seed, reach=0.08, stiffness=40.0, radius=0.03, frames=12, rest=10)
    return random_pulls("pulls", body.mesh.vertices[body.movable], options)


@pytest.fixture(scope="module")
def frames(body: Scene) -> Array:
    """The full-space run of the pulls of seed 1, (N, 3n)."""
    motion = pulled(body, 1)
    stepper = FullStepper(body, FullOptions(tolerance=1e-9))
    return np.array([stepper.displacement(frame.state).ravel() for frame in simulate(stepper, motion)])


@pytest.fixture(scope="module")
def space(body: Scene, frames: Array) -> tuple[Array, ReducedStepper]:
    """The coordinates of the frames in a basis, orthonormal in mass, and what steps synthetic motions."""
    mass = kron(body.mass, eye_array(3)).tocsr()
    values, vectors = np.linalg.eigh(frames @ (mass @ frames.T))
    U = np.ascontiguousarray(frames.T @ vectors[:, -K:] / np.sqrt(values[-K:]))[:, ::-1].copy()
    basis = Basis.of(U, body.mass)
    q = basis.project(frames)
    return q, synthetic_stepper(body, basis, q, seed=0)


def test_the_rule_of_a_large_solid_is_looked_for_among_some_of_its_points(
    body: Scene, space: tuple[Array, ReducedStepper], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = FitOptions(tolerance=0.03, candidates=20, max_points=8)
    monkeypatch.setattr("ldsim.dynamics.synthetic.FIT", options)
    q, stepper = space
    rule = synthetic_stepper(body, stepper.space.reduced_basis, q, 0).space.rule
    candidates = drawn_candidates(body.points.n_points, options)
    assert candidates is not None and set(rule.points) <= set(candidates)


def test_a_training_motion_runs_as_in_the_full_space(body: Scene, space: tuple[Array, ReducedStepper]) -> None:
    q, stepper = space
    told: list[int] = []
    again = synthetic_frames(stepper, pulled(body, 1), lambda: told.append(1))
    assert again.shape == q.shape
    assert len(told) == len(q)
    assert np.linalg.norm(again - q) < 0.05 * np.linalg.norm(q)


def test_another_motion_gives_other_poses(body: Scene, space: tuple[Array, ReducedStepper]) -> None:
    q, stepper = space
    other = synthetic_frames(stepper, pulled(body, 2), lambda: None)
    assert np.linalg.norm(other - q) > 0.2 * np.linalg.norm(q)


def test_gravity_of_the_motion_is_the_gravity_of_the_run(body: Scene, space: tuple[Array, ReducedStepper]) -> None:
    _, stepper = space
    hanging = synthetic_frames(stepper, Motion("hang", 20), lambda: None)
    still = synthetic_frames(stepper, replace(Motion("float", 20), gravity=np.zeros((20, 3))), lambda: None)
    assert np.linalg.norm(hanging[-1]) > 1e-3
    assert np.linalg.norm(still) < 1e-9


@pytest.mark.parametrize("cores", [1, 3])
def test_each_group_of_frames_starts_at_rest_whatever_the_cores(
    body: Scene, space: tuple[Array, ReducedStepper], cores: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: cores)
    _, stepper = space
    motion = pulled(body, 1)
    told: list[int] = []
    q = synthetic_frames(stepper, motion, lambda: told.append(1), together=22)
    assert len(q) == len(told) == motion.frames == 66
    np.testing.assert_array_equal(q[:22], synthetic_frames(stepper, motion.first(22), lambda: None))
    for drag in range(3):
        own = replace(motion.drags[drag], start=0)
        alone = synthetic_frames(stepper, Motion("alone", 22, (own,)), lambda: None)
        np.testing.assert_array_equal(q[22 * drag : 22 * drag + 22], alone)


def test_a_lost_run_keeps_the_frames_before(
    body: Scene, space: tuple[Array, ReducedStepper], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, stepper = space
    good = synthetic_frames(stepper, Motion("hang", 6), lambda: None)
    step, count = stepper.step, iter(range(100))

    def lost(*given: Any) -> object:
        state, solution = step(*given)
        if next(count) == 4:
            state.q[:] = np.nan
        return state, solution

    monkeypatch.setattr(stepper, "step", lost)
    kept = synthetic_frames(stepper, Motion("hang", 6), lambda: None)
    np.testing.assert_array_equal(kept, good[:4])
