"""The fit: what it promises of every set, and problems whose answer is known."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from ldsim.cubature.methods import fit
from ldsim.cubature.options import CubatureOptions, FitOptions, TermOptions
from ldsim.cubature.path import RulePath, Tell, relative_errors
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.system import System
from ldsim.cubature.terms import ForceTerm, Term
from ldsim.errors import SolverError
from tests.cubature.cubature_problems import GivenColumns, Problem, beam_scene, latent_problem, linear_problem

TOLERANCE = 0.05


PROBLEMS: dict[str, Callable[[], Problem]] = {
    "linear tet4": lambda: linear_problem(beam_scene((8, 3, 3), "tet4"), k=8, count=30),
    "latent tet4": lambda: latent_problem(beam_scene((8, 3, 3), "tet4"), r=4, k=10, count=30),
    "latent hex8": lambda: latent_problem(beam_scene((4, 2, 2), "hex8"), r=4, k=10, count=30),
}


@cache
def forces_of(name: str) -> ForceTerm:
    return PROBLEMS[name]().forces()


def fit_to(forces: Term, tolerance: float, most: int, volume: float = 0.3, tell: Tell | None = None) -> RulePath:
    options = FitOptions(tolerance=tolerance, max_points=most, terms=TermOptions(volume=volume))
    return fit(System(forces, volume), options, tell)


def relative_error(forces: Term, rule: CubatureRule) -> float:
    return float(relative_errors(forces, [rule])[0])


@cache
def fitted(name: str, volume: float = 0.3) -> RulePath:
    return fit_to(forces_of(name), TOLERANCE, 100, volume)


@pytest.fixture(params=PROBLEMS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_every_point_with_its_full_weight_has_no_error(name: str) -> None:
    forces = forces_of(name)
    whole = CubatureRule(np.arange(len(forces.point_weights)), forces.point_weights, 0.0)
    assert relative_error(forces, whole) < 1e-13
    half = CubatureRule(whole.points, 0.5 * whole.weights, 0.0)
    assert relative_error(forces, half) == pytest.approx(0.5)


def test_the_tolerance_is_met_with_a_small_part_of_the_points(name: str) -> None:
    best = fitted(name).best
    assert fitted(name).meets(TOLERANCE)
    assert relative_error(forces_of(name), best) <= TOLERANCE
    assert len(best.points) <= 0.15 * len(forces_of(name).point_weights)


def test_the_path_climbs_to_the_best_rule_with_positive_weights_and_true_errors(name: str) -> None:
    rules = fitted(name).rules
    assert rules[-1] is fitted(name).best
    assert len(rules[0].points) <= 2
    assert (np.diff([len(rule.points) for rule in rules]) > 0).all()
    assert (np.diff([rule.training_error for rule in rules]) < 0).all()
    for rule in rules:
        assert (rule.weights > 0).all()
        assert (np.diff(rule.points) > 0).all()
        assert rule.training_error == pytest.approx(relative_error(forces_of(name), rule), abs=1e-10)


@pytest.mark.parametrize("tolerance", [0.4, 0.2, 0.15, 0.1, 0.07, 0.03])
def test_the_best_rule_is_the_smallest_of_the_path_that_meets_the_tolerance(name: str, tolerance: float) -> None:
    found = fit_to(forces_of(name), tolerance, 100)
    assert found.best.training_error <= tolerance
    assert all(rule.training_error > tolerance for rule in found.rules[:-1])


def test_a_heavy_volume_row_makes_the_weights_sum_to_the_volume(name: str) -> None:
    volume = forces_of(name).point_weights.sum()
    free, bound = fitted(name, 0.0).best.weights.sum(), fitted(name, 10.0).best.weights.sum()
    assert abs(bound - volume) < 1e-3 * volume < abs(free - volume)


def test_held_out_poses_are_integrated_nearly_as_well() -> None:
    p = PROBLEMS["linear tet4"]()
    held_out = p.forces(p.held_out)
    assert relative_error(held_out, fitted("linear tet4").best) < 3 * TOLERANCE


def test_a_greedy_choice_that_a_pair_makes_superfluous_is_taken_out_again() -> None:
    # Columns 0 and 1 sum to the target; column 2 points closest to it and so is chosen first.
    a, b, noise = np.eye(3)
    first = (a + b) / np.sqrt(2) + 0.3 * noise
    A = np.stack([a, b, 0.9 * first, -0.9 * first], axis=1)
    problem = GivenColumns(A, np.ones(4))
    found = fit_to(problem, 1e-6, 4, 0.0)
    assert found.rules[0].points.tolist() == [2]
    assert found.best.points.tolist() == [0, 1]
    assert np.allclose(found.best.weights, 1.0)


def test_exchanges_lower_the_error_of_as_many_points(monkeypatch: pytest.MonkeyPatch) -> None:
    exchanged = fit_to(forces_of("linear tet4"), 1e-4, 12)
    monkeypatch.setattr("ldsim.cubature.point_exchange.EXCHANGES", 0)
    greedy = fit_to(forces_of("linear tet4"), 1e-4, 12)
    assert len(greedy.best.points) == len(exchanged.best.points) == 12
    assert exchanged.best.training_error < 0.95 * greedy.best.training_error


@pytest.mark.parametrize("limit", [1, 5])
def test_the_limit_of_points_holds_and_the_miss_is_told(limit: int) -> None:
    found = fit_to(forces_of("linear tet4"), 1e-4, limit)
    assert not found.meets(1e-4)
    assert len(found.best.points) <= limit
    assert found.best.training_error == min(rule.training_error for rule in found.rules)


def test_progress_tells_falling_errors_while_points_are_added() -> None:
    told: list[tuple[int, float]] = []
    fit_to(forces_of("linear tet4"), TOLERANCE, 100, 0.0, lambda points, error: told.append((points, error)))
    grown = next(i for i, (_, error) in enumerate(told) if error <= TOLERANCE) + 1
    errors = [error for _, error in told[:grown]]
    assert told[0][0] == 1
    assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tolerance": 0.0}, "tolerance\n.*greater than 0"),
        ({"tolerance": -1.0}, "tolerance\n.*greater than 0"),
        ({"tolerance": float("nan")}, "tolerance\n.*finite"),
        ({"max_points": 0}, "max_points\n.*greater than or equal to 1"),
        ({"terms": {"volume": -0.1}}, "terms.volume\n.*greater than or equal to 0"),
        ({"terms": {"volume": float("inf")}}, "terms.volume\n.*finite"),
        ({"terms": {"closure": 1.5}}, "terms.closure\n.*less than or equal to 1"),
        ({"terms": {"closure": -0.1}}, "terms.closure\n.*greater than or equal to 0"),
        ({"terms": {"closure": float("nan")}}, "terms.closure\n.*finite"),
        ({"virtual": {"closures": (1.5,)}}, "virtual.closures.0\n.*less than or equal to 1"),
        ({"method": "magic"}, "method\n.*should be 'exchange', 'ecsw'"),
    ],
)
def test_an_option_out_of_range_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        CubatureOptions.model_validate(options)


@pytest.mark.parametrize(
    ("points", "weights", "words"),
    [
        ([0, 1], [1.0], "shape"),
        ([0, 1], [1.0, 0.0], "must be positive"),
        ([0, 1], [1.0, -2.0], "must be positive"),
        ([0], [np.nan], "must be positive"),
        ([3, 3], [1.0, 1.0], "twice"),
    ],
)
def test_a_set_that_is_no_quadrature_rule_is_refused(points: list[int], weights: list[float], words: str) -> None:
    with pytest.raises(SolverError, match=words):
        CubatureRule(np.array(points), np.array(weights), 0.0)


def test_the_errors_of_many_rules_are_those_of_each() -> None:
    forces, rules = forces_of("latent tet4"), fitted("latent tet4").rules
    one_by_one = [relative_error(forces, rule) for rule in rules]
    assert np.allclose(relative_errors(forces, rules), one_by_one, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("point", [-1, 10**6])
def test_a_set_of_another_scene_is_refused(point: int) -> None:
    with pytest.raises(SolverError, match="the scene it was fitted on"):
        relative_error(forces_of("latent tet4"), CubatureRule(np.array([point]), np.ones(1), 0.0))
