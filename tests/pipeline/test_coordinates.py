"""Coordinates of a condensed space: equilibria are relaxed poses; the fewest that are enough are found, or the best."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

from ldsim.arrays import Array
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.motion import Drag, Motion
from ldsim.pipeline import coordinates
from ldsim.pipeline.coordinates import OF_CHANGE, Slaving, combined, frames_of, needed_coordinates, slaving
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
    assert slaving(Compliance(BODY, modes(BODY, r)), frames).worst < 1e-3


def test_more_coordinates_hold_large_equilibria_better() -> None:
    frames = [equilibrium(0.25), equilibrium(-0.2)]
    errors = [slaving(Compliance(BODY, modes(BODY, r)), frames).worst for r in (1, 4, 10)]
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
    assert slaving(compliance, [(u, loads)]).off == pytest.approx(off[0], rel=1e-9)
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


def choosing(monkeypatch: pytest.MonkeyPatch, k: int, known: Callable[[int, str], Slaving]) -> Any:
    """A run of which nothing is known but what so many coordinates in either order are off."""
    orders = {"largest": np.eye(k), "slowest": np.eye(k)[:, ::-1]}
    monkeypatch.setattr(coordinates, "Compliance", lambda scene, columns: columns)
    monkeypatch.setattr(coordinates, "combined", lambda basis, combinations: combinations)
    monkeypatch.setattr(coordinates, "frames_of", lambda run: ())
    monkeypatch.setattr(coordinates, "slowest", lambda run: orders["slowest"])

    def found(columns: Array, frames: object) -> Slaving:
        name = next(name for name, order in orders.items() if order[:, 0] @ columns[:, 0])
        return known(columns.shape[1], name)

    monkeypatch.setattr(coordinates, "slaving", found)
    return SimpleNamespace(scene=None, basis=SimpleNamespace(k=k))


@pytest.mark.parametrize(
    ("least", "k", "found"), [(1, 40, 4), (9, 40, 10), (13, 40, 16), (90, 40, 8), (90, 7, 4), (1, 3, 3)]
)
def test_the_fewest_that_are_enough_are_found(monkeypatch: pytest.MonkeyPatch, least: int, k: int, found: int) -> None:
    """Though a run were less off with fewer; these are taken where none are enough."""

    def known(size: int, name: str) -> Slaving:
        return Slaving(np.array([0.001 if size >= least else 0.003, np.nan]), np.array([size, np.nan]), size)

    run = choosing(monkeypatch, k, known)
    assert needed_coordinates(run, None, SILENT).shape == (k, found)


@pytest.mark.parametrize(("change", "found"), [(1.0, 16), (6.0, 16), (8.0, 12)])
def test_where_none_is_enough_those_are_taken_with_which_a_run_is_least_off(
    monkeypatch: pytest.MonkeyPatch, change: float, found: int
) -> None:
    """More miss less, and what V_eff misses grows with their cube and with the square of the change of stiffness."""

    def known(size: int, name: str) -> Slaving:
        return Slaving(np.array([0.32 / size]), np.array([change if name == "slowest" else 2 * change]), size)

    assert found == min((8, 12, 16), key=lambda size: 0.32 / size + OF_CHANGE * (size / 12) ** 3 * change**2)
    chosen = needed_coordinates(choosing(monkeypatch, 40, known), None, SILENT)
    np.testing.assert_array_equal(chosen, np.eye(40)[:, ::-1][:, :found])


@pytest.mark.parametrize(
    ("off", "k", "found"),
    [
        ({20: 0.7, 24: 0.5}, 40, 24),
        ({20: 0.7, 24: 0.55}, 40, 20),  # of 0.7 no quarter less
        ({20: 0.8, 24: 0.1}, 40, 16),
        ({20: 0.7, 24: 0.5}, 24, 20),  # a space of all columns has nothing beside them
    ],
)
def test_more_than_sixteen_are_taken_where_a_run_is_expected_to_be_a_quarter_less_off_with_each_four_more(
    monkeypatch: pytest.MonkeyPatch, off: dict[int, float], k: int, found: int
) -> None:
    def known(size: int, name: str) -> Slaving:
        return Slaving(np.array([0.1 * off.get(size, 16 / size)]), np.zeros(1), size)

    assert needed_coordinates(choosing(monkeypatch, k, known), None, SILENT).shape == (k, found)


@pytest.mark.parametrize(("r", "off", "found"), [(None, 0.002, 4), (16, 0.1, 16)])
def test_more_than_sixteen_are_not_asked_for_where_fewer_are_enough_or_a_number_is_given(
    monkeypatch: pytest.MonkeyPatch, r: int | None, off: float, found: int
) -> None:
    def known(size: int, name: str) -> Slaving:
        return Slaving(np.array([off if size <= 16 else 0.0]), np.zeros(1), size)

    assert needed_coordinates(choosing(monkeypatch, 40, known), r, SILENT).shape == (40, found)


@pytest.mark.parametrize("off", [np.nan, np.inf])
def test_where_nothing_can_be_told_there_are_as_many_as_there_may_be(
    monkeypatch: pytest.MonkeyPatch, off: float
) -> None:
    run = choosing(monkeypatch, 40, lambda size, name: Slaving(np.array([off]), np.array([np.nan]), size))
    assert needed_coordinates(run, None, SILENT).shape == (40, 16)


def test_of_as_many_as_are_enough_in_one_order_those_of_the_other_may_be_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known = {
        "largest": Slaving(np.array([0.002]), np.array([12.0]), 12),
        "slowest": Slaving(np.array([0.01]), np.zeros(1), 12),
    }
    assert known["slowest"].expected < known["largest"].expected
    chosen = needed_coordinates(choosing(monkeypatch, 40, lambda size, name: known[name]), None, SILENT)
    np.testing.assert_array_equal(chosen, np.eye(40)[:, ::-1][:, :4])


def test_a_frame_counts_at_most_as_all_of_its_motion() -> None:
    lost = Slaving(np.array([np.nan, 0.0]), np.array([np.nan, 0.0]), 12)
    assert lost.expected == Slaving(np.array([0.01, 0.0]), np.array([1e3, 0.0]), 12).expected == 0.5


@pytest.mark.parametrize(
    ("largest", "slowest", "changes", "better"),
    [
        ([0.1, 0.2], [0.2, 0.2], (1.0, 1.0), "largest"),
        ([0.1, 0.3], [0.31, 0.0], (1.0, 1.0), "slowest"),
        ([0.1, 0.0], [0.0, np.nan], (1.0, 1.0), "largest"),
        ([0.01, 0.01], [0.02, 0.02], (12.0, 1.0), "slowest"),  # 1 % and 2 % are missed, and by V_eff 1.4 % and 0.01 %
        ([0.01, 0.01], [0.02, 0.02], (5.0, 1.0), "largest"),
    ],
)
def test_that_order_is_taken_with_which_a_run_is_least_off_and_a_lost_frame_is_all_of_its_motion_off(
    monkeypatch: pytest.MonkeyPatch,
    largest: list[float],
    slowest: list[float],
    changes: tuple[float, float],
    better: str,
) -> None:
    found = {
        name: Slaving(np.array(off), change + 0 * np.array(off), 12)
        for name, off, change in zip(("largest", "slowest"), (largest, slowest), changes, strict=True)
    }
    run = choosing(monkeypatch, 5, lambda size, name: found[name])
    columns = {"largest": np.eye(5), "slowest": np.eye(5)[:, ::-1]}[better][:, :3]
    np.testing.assert_array_equal(needed_coordinates(run, 3, SILENT), columns)


def test_how_much_the_stiffness_changes_is_seen_in_units_of_that_of_rest() -> None:
    """S x = λ S₀ x; at rest all λ are 1."""
    compliance = Compliance(BODY, modes(BODY, 3))
    u, loads = equilibrium(0.25)
    relaxation = compliance.relaxation
    values = eigh(relaxation.from_pose(u).stiffness, relaxation.rest.stiffness, eigvals_only=True)
    found = slaving(compliance, [(0 * u, Loads()), (u, loads)]).change
    assert found[0] == pytest.approx(0, abs=1e-9)
    assert found[1] == pytest.approx(np.sqrt(np.mean((values - 1) ** 2)), rel=1e-6) and found[1] > 0.01


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
