"""How many coordinates a condensed space needs: equilibria are relaxed poses, the least that is enough is found."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.motion import Drag, Motion
from ldsim.pipeline import coordinates
from ldsim.pipeline.coordinates import combined, frames_of, needed_coordinates, slaving_errors
from ldsim.pipeline.coordinates import slowest as slowest_of
from ldsim.pipeline.progress import SILENT
from ldsim.space.compliance import Compliance
from tests.space.test_relaxation import beam, modes

BODY = beam()


def equilibrium(pull: float, gravity: float = 0.0) -> tuple[Array, Loads]:
    """A beam whose end is pulled sideways to a target so far away, metres, under some gravity, m/s²."""
    end = np.flatnonzero(BODY.mesh.vertices[:, 0] > 0.29)
    target = BODY.mesh.vertices[end].mean(axis=0) + pull * np.array([0.0, 1.0, 0.4])
    loads = Loads((Grab(end, target, 200.0),), gravity=np.array([0.0, gravity, 0.0]))
    stepper = FullStepper(BODY, FullOptions(tolerance=1e-10, quasistatic=True))
    state, solution = stepper.step(stepper.rest(), loads)
    assert solution.converged
    return stepper.displacement(state), loads


@pytest.mark.parametrize("r", [1, 3])
def test_small_equilibria_are_relaxed_poses_of_however_few_coordinates(r: int) -> None:
    """To first order what is slaved and its compliance are exact: u = T z + C f."""
    frames = [equilibrium(1e-6), equilibrium(1e-6, gravity=1e-3)]
    assert slaving_errors(Compliance(BODY, modes(BODY, r)), frames).max() < 1e-3


def test_more_coordinates_hold_large_equilibria_better() -> None:
    frames = [equilibrium(0.25), equilibrium(-0.2)]
    errors = [slaving_errors(Compliance(BODY, modes(BODY, r)), frames).max() for r in (1, 4, 10)]
    assert errors[0] > 0.01 and errors[1] < 0.5 * errors[0] and errors[2] < 0.5 * errors[1]


def test_a_dent_does_not_turn_the_compliance_that_makes_it() -> None:
    """In a step A is that of the decoded pose, which has no dent; so it is where coordinates are chosen."""
    u, loads = equilibrium(0.25)
    compliance = Compliance(BODY, modes(BODY, 2))
    relaxed, (grab,) = compliance.relaxation.from_pose(u).u, loads.grabs
    force = grab.stiffness * (grab.target - (BODY.mesh.vertices + u)[grab.vertices].mean(axis=0))
    drawn = [
        relaxed + compliance.sag(loads.gravity) + compliance.moved(grab.vertices, at, force) for at in (relaxed, u)
    ]
    off = [float(np.linalg.norm(each - u, axis=1).mean() / np.linalg.norm(u, axis=1).mean()) for each in drawn]
    assert slaving_errors(compliance, [(u, loads)]) == pytest.approx(off[0], rel=1e-9)
    assert abs(off[1] - off[0]) > 1e-3 * off[0]


def test_its_compliance_turns_with_the_solid() -> None:
    """The end of a beam that is bent far and drawn along itself sinks in along itself."""
    u, loads = equilibrium(0.25)
    compliance = Compliance(BODY, modes(BODY, 4))
    pose = compliance.relaxation.from_pose(u).u
    (grab,) = loads.grabs
    force = grab.stiffness * (grab.target - (BODY.mesh.vertices + u)[grab.vertices].mean(axis=0))
    beside = u - pose
    straight, turned = compliance.of_grab(grab.vertices) @ force, compliance.moved(grab.vertices, u, force)
    assert np.linalg.norm(turned - beside) < 0.5 * np.linalg.norm(straight - beside)


@pytest.mark.parametrize(
    ("least", "k", "poses", "found"),
    [
        (1, 40, 900, 4),
        (9, 40, 900, 10),
        (13, 40, 900, 16),
        (90, 40, 900, 16),
        (90, 40, 4 * 136, 16),  # four poses for each of the entries of a symmetric 16 × 16 matrix
        (90, 40, 4 * 136 - 1, 12),
        (9, 40, 400, 10),
        (90, 40, 3, 4),
        (90, 7, 900, 6),
        (1, 3, 900, 3),
    ],
)
def test_the_least_dimension_that_is_enough_is_found_among_those_that_the_poses_can_tell(
    monkeypatch: pytest.MonkeyPatch, least: int, k: int, poses: int, found: int
) -> None:
    monkeypatch.setattr(coordinates, "Compliance", lambda scene, size: size)
    monkeypatch.setattr(coordinates, "combined", lambda basis, combinations: combinations.shape[1])
    monkeypatch.setattr(coordinates, "frames_of", lambda run: ())
    monkeypatch.setattr(coordinates, "slowest", lambda run: np.eye(k))
    monkeypatch.setattr(
        coordinates, "slaving_errors", lambda r, frames: np.array([0.001 if r >= least else 0.1, np.nan])
    )
    run: Any = SimpleNamespace(scene=None, basis=SimpleNamespace(k=k))
    assert needed_coordinates(run, None, poses, SILENT).shape == (k, found)


@pytest.mark.parametrize(
    ("largest", "slowest", "better"),
    [([0.1, 0.2], [0.2, 0.2], "largest"), ([0.1, 0.3], [0.31, 0.0], "slowest"), ([0.1, 0.0], [0.0, np.nan], "largest")],
)
def test_the_order_that_is_nearer_in_the_mean_is_taken_and_a_lost_frame_counts_as_all_of_its_motion(
    monkeypatch: pytest.MonkeyPatch, largest: list[float], slowest: list[float], better: str
) -> None:
    orders = {"largest": np.eye(5), "slowest": np.eye(5)[:, ::-1]}
    monkeypatch.setattr(coordinates, "Compliance", lambda scene, columns: columns)
    monkeypatch.setattr(coordinates, "combined", lambda basis, combinations: combinations)
    monkeypatch.setattr(coordinates, "frames_of", lambda run: ())
    monkeypatch.setattr(coordinates, "slowest", lambda run: orders["slowest"])
    errors = {0: np.array(largest), 4: np.array(slowest)}
    monkeypatch.setattr(coordinates, "slaving_errors", lambda columns, frames: errors[int(columns[:, 0].argmax())])
    run: Any = SimpleNamespace(scene=None, basis=SimpleNamespace(k=5))
    np.testing.assert_array_equal(needed_coordinates(run, 3, 1, SILENT), orders[better][:, :3])


def test_the_slowest_combinations_are_vibration_modes_where_the_basis_holds_them() -> None:
    """Mixed up by a rotation, the modes come back, the slowest first."""
    own = modes(BODY, 6)
    mixed = np.linalg.qr(np.random.default_rng(1).normal(size=(6, 6)))[0]
    run: Any = SimpleNamespace(scene=BODY, basis=combined(own, mixed))
    again = combined(run.basis, slowest_of(run))
    overlap = np.abs(own.project(again.matrix.T))
    np.testing.assert_allclose(overlap, np.eye(6), atol=1e-6)


def test_of_a_pull_that_the_end_of_its_motion_cuts_the_last_frame_is_taken() -> None:
    """A pull that would begin after the end has none."""
    point, count = BODY.mesh.vertices[-1], 10
    pulls = tuple(Drag(start, point, np.tile(point, (6, 1)), 0.01, 10.0, at_rest=True) for start in (0, 7, 12))
    held = {i: np.array([BODY.mesh.n_vertices - 1]) for i in range(len(pulls))}
    frames = np.arange(count)[:, None, None] * np.ones((1, BODY.mesh.n_vertices, 3))
    snapshots = SimpleNamespace(
        with_role=lambda role: ["a"] * 8,
        recorded=lambda name: SimpleNamespace(motion=Motion("a", count, pulls), held=held),
        reader=lambda name: lambda start, stop: frames[start:stop],
        frames=lambda name: count,
    )
    run: Any = SimpleNamespace(scene=BODY, snapshots=snapshots)
    assert {int(u[0, 0]) for u, _ in frames_of(run)} <= {5, 9}
