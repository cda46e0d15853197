"""The choice of poses and the fit of one space from a recipe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldsim.cubature.forces import ProjectedForces
from ldsim.cubature.goal import Goal
from ldsim.cubature.ladder import relative_errors
from ldsim.cubature.selection import PoseSpace, Recipe, perturb, select, split_poses
from ldsim.dynamics.reduced.stepper import reduced_rest_stiffness
from ldsim.errors import SolverError
from ldsim.space.basis import Basis
from tests.cubature.cubature_problems import beam_scene, latent_problem

RECIPE = Recipe(Goal(0.1, 60), threads=1)
FITTED, KEPT_BACK = np.arange(0, 30), np.arange(30, 50)


@pytest.fixture(scope="module")
def space() -> PoseSpace:
    p = latent_problem(beam_scene((6, 2, 2), "tet4"), r=4, k=9, count=50)
    poses = (p.decoder(p.z) @ p.U.T).reshape(50, -1, 3)
    stiffness = reduced_rest_stiffness(p.scene, Basis.of(p.U, p.scene.mass))
    return PoseSpace(p.scene, p.U, p.decoder, stiffness, p.z, lambda t: 1.02 * poses[t])


def test_poses_to_fit_and_to_judge_are_disjoint_and_rise() -> None:
    fitted, kept_back = split_poses(100, 60, 40, seed=3)
    assert sorted([*fitted, *kept_back]) == list(range(100))
    assert (np.diff(fitted) > 0).all()
    assert (np.diff(kept_back) > 0).all()


def test_fewer_poses_than_asked_for_are_refused() -> None:
    with pytest.raises(SolverError, match="needs 60 poses to fit and 41 to judge, but there are 100"):
        split_poses(100, 60, 41, seed=3)


def test_perturbed_poses_are_so_many_deviations_away() -> None:
    z = np.random.default_rng(0).standard_normal((4000, 3)) * [1.0, 10.0, 100.0]
    moved = perturb(z, np.arange(4000), 0.2, (1,)) - z
    assert np.allclose(moved.std(axis=0), 0.2 * z.std(axis=0), rtol=0.05)


def test_every_set_is_judged_on_poses_that_the_fit_did_not_see(space: PoseSpace) -> None:
    found = select(space, FITTED, KEPT_BACK, replace(RECIPE, compliance=False))
    judge = ProjectedForces(space.scene, space.U, space.decoder, space.z[KEPT_BACK])
    assert np.allclose(found.heldout_errors, relative_errors(judge, found.fit.ladder), rtol=1e-10)
    assert found.heldout_errors[-1] < 0.3
    assert found.perturbed_errors.shape == found.heldout_errors.shape
    assert found.perturbed_errors[-1] != found.heldout_errors[-1]


def test_a_set_fitted_in_the_space_of_the_basis_is_judged_in_the_latent_one(space: PoseSpace) -> None:
    latent = select(space, FITTED, KEPT_BACK, replace(RECIPE, goal=Goal(1e-6, 12)))
    linear = select(space, FITTED, KEPT_BACK, replace(RECIPE, goal=Goal(1e-6, 12), latent=False))
    assert len(linear.fit.best.points) == len(latent.fit.best.points) == 12
    assert latent.heldout_errors[-1] < linear.heldout_errors[-1]


def test_fitted_perturbed_states_lower_the_error_on_perturbed_states(space: PoseSpace) -> None:
    recipe = replace(RECIPE, goal=Goal(1e-6, 12), perturbation=0.5)
    without = select(space, FITTED[:3], KEPT_BACK, recipe)
    fitted = select(space, FITTED[:3], KEPT_BACK, replace(recipe, perturbed=1.0))
    assert fitted.perturbed_errors[-1] < without.perturbed_errors[-1]


def test_a_closure_to_stronger_poses_makes_the_weights_heavier(space: PoseSpace) -> None:
    plain = select(space, FITTED, KEPT_BACK, replace(RECIPE, goal=Goal(0.05, 60, 0.0))).fit.best
    closed = select(space, FITTED, KEPT_BACK, replace(RECIPE, goal=Goal(0.05, 60, 0.0), closure=1.0)).fit.best
    assert 1.01 < closed.weights.sum() / plain.weights.sum() < 1.2


def test_few_candidates_cost_points_and_not_the_tolerance(space: PoseSpace) -> None:
    every = select(space, FITTED, KEPT_BACK, RECIPE).fit
    some = select(space, FITTED, KEPT_BACK, replace(RECIPE, candidates=40)).fit
    assert every.met
    assert some.met
    assert len(some.best.points) >= len(every.best.points)


def test_tangents_and_energies_join_where_they_have_a_weight(space: PoseSpace) -> None:
    recipe = replace(RECIPE, goal=Goal(0.01, 60))
    plain = select(space, FITTED, KEPT_BACK, recipe).fit.best
    for more in ({"tangent": 1.0}, {"energy": 1.0}):
        other = select(space, FITTED, KEPT_BACK, replace(recipe, **more)).fit  # type: ignore[arg-type]
        assert other.met
        assert not np.array_equal(other.best.points, plain.points)
