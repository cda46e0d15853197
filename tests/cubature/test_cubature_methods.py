"""Every method: what all promise, and problems whose answer is known."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.optimize import nnls

from ldsim.cubature.methods import METHODS, fit
from ldsim.cubature.options import FitOptions
from ldsim.cubature.path import PathBuilder, RulePath, relative_errors
from ldsim.cubature.system import Candidates, System
from ldsim.cubature.terms import ForceTerm, Term
from tests.cubature.cubature_problems import GivenColumns, beam_scene, latent_problem, two_materials

SOLVED = sorted(set(METHODS) - {"uniform"})
every_method = pytest.mark.parametrize("method", sorted(METHODS))
every_solved = pytest.mark.parametrize("method", SOLVED)


@cache
def forces(kind: str = "tet4") -> ForceTerm:
    scene = two_materials(beam_scene((8, 3, 3) if kind == "tet4" else (4, 2, 2), kind))
    p = latent_problem(scene, r=4, k=10, count=30)
    return p.forces()


def options(method: str, tolerance: float, most: int, seed: int = 0) -> FitOptions:
    return FitOptions.model_validate({"method": method, "tolerance": tolerance, "max_points": most, "seed": seed})


def fit_to(term: Term, given: FitOptions, volume: float = 0.3) -> RulePath:
    return fit(System(term, volume), given)


@cache
def found(method: str, kind: str = "tet4", volume: float = 0.3) -> RulePath:
    return fit_to(forces(kind), options(method, 0.1, 80), volume)


@every_method
@pytest.mark.parametrize("kind", ["tet4", "hex8"])
def test_weights_are_positive_errors_true_and_the_path_climbs_from_few_points(method: str, kind: str) -> None:
    rules = found(method, kind).rules
    assert len(rules[0].points) <= 2
    assert (np.diff([len(rule.points) for rule in rules]) > 0).all()
    assert (np.diff([rule.training_error for rule in rules]) < 0).all()
    some = rules[:: max(len(rules) // 5, 1)]
    for rule, error in zip(some, relative_errors(forces(kind), some), strict=True):
        assert (rule.weights > 0).all()
        assert rule.training_error == pytest.approx(error, abs=1e-10)


@every_solved
@pytest.mark.parametrize("kind", ["tet4", "hex8"])
def test_a_solved_method_meets_its_tolerance_with_a_small_part_of_the_points(method: str, kind: str) -> None:
    assert found(method, kind).meets(0.1)
    assert found(method, kind).best.training_error <= 0.1


@every_solved
def test_scipys_nnls_agrees_with_the_weights_on_the_points_chosen(method: str) -> None:
    best = found(method, volume=0.0).best
    multipliers, residual = nnls(forces().columns(best.points), forces().target)
    assert np.allclose(multipliers * forces().point_weights[best.points], best.weights, rtol=1e-5)
    assert residual / np.linalg.norm(forces().target) == pytest.approx(best.training_error, rel=1e-8)


@every_solved
def test_an_exact_subset_is_found_where_all_points_are_copies_of_a_few(method: str) -> None:
    rng = np.random.default_rng(0)
    few = np.linalg.qr(rng.standard_normal((60, 7)))[0]
    origin = rng.permutation(np.repeat(np.arange(7), 30))
    columns = few[:, origin] * rng.uniform(0.5, 2.0, len(origin))
    result = fit_to(GivenColumns(columns, rng.uniform(1.0, 2.0, len(origin))), options(method, 1e-6, 50), 0.0)
    assert result.meets(1e-6)
    assert sorted(set(origin[result.best.points])) == list(range(7))
    assert len(result.best.points) == 7 or method == "nn_htp"


@every_solved
def test_a_method_starting_at_every_point_with_its_full_weight_stays_there(method: str) -> None:
    rng = np.random.default_rng(1)
    problem = GivenColumns(rng.standard_normal((40, 12)), np.ones(12))
    system = System(problem, 0.3)
    whole = Candidates.none(system).given(np.arange(12), np.ones(12))
    assert whole.error < 1e-13
    assert np.allclose(whole.solved_on(np.arange(12)).multipliers, 1.0, atol=1e-8)
    path = PathBuilder()
    path.record(whole)
    METHODS[method](whole, options(method, 1e-6, 12), path)
    assert np.allclose(path.path(1e-9).best.weights, 1.0, atol=1e-6)


@every_solved
def test_points_of_cells_that_are_pinned_whole_are_passed_over_where_the_volume_does_not_count(method: str) -> None:
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((40, 60)) * (np.arange(60) % 2)  # every other one is zero
    result = fit_to(GivenColumns(columns, np.ones(60)), options(method, 1e-6, 60), 0.0)
    assert result.meets(1e-6)
    assert (result.best.points % 2 == 1).all()


@every_method
def test_only_candidates_are_chosen_and_the_error_is_that_of_all_points(method: str) -> None:
    p = latent_problem(beam_scene((8, 3, 3), "tet4"), r=4, k=10, count=30)
    some = np.arange(0, p.scene.points.n_points, 4)
    restricted = p.forces(candidates=some)
    best = fit(System(restricted, 0.3, candidates=some), options(method, 0.1, 60)).best
    assert set(best.points) <= set(some)
    assert relative_errors(p.forces(), [best])[0] == pytest.approx(best.training_error, abs=1e-10)


@pytest.mark.parametrize("method", ["an", "uniform"])
def test_a_seed_gives_one_answer_and_another_seed_another(method: str) -> None:
    first, again, other = (fit_to(forces(), options(method, 0.2, 40, seed)).best for seed in (0, 0, 1))
    assert np.array_equal(first.points, again.points)
    assert np.array_equal(first.weights, again.weights)
    assert not np.array_equal(first.points, other.points)


def test_random_points_with_equal_shares_are_the_floor() -> None:
    floor = found("uniform")
    assert all(np.allclose(rule.weights, rule.weights.mean()) for rule in floor.rules)
    assert floor.rules[0].weights.sum() == pytest.approx(forces().point_weights.sum())
    for method in SOLVED:
        best = found(method).best
        assert floor.at_most(len(best.points)).training_error > 2 * best.training_error


def test_exchange_needs_the_fewest_points() -> None:
    sizes = {method: len(found(method).best.points) for method in SOLVED}
    assert sizes["exchange"] == min(sizes.values())
