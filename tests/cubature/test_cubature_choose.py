"""The choice of poses and the fit of one space from its options."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.cubature.choose import PoseSplit, choose_on_mesh, split_poses
from ldsim.cubature.options import CubatureOptions, FitOptions
from ldsim.cubature.path import RulePath, relative_errors
from ldsim.cubature.samples import PoseSpace, perturbed
from ldsim.cubature.terms import ForceTerm
from ldsim.dynamics.reduced.matrices import reduced_rest_stiffness
from ldsim.errors import SolverError
from tests.cubature.cubature_problems import beam_scene, latent_problem

FITTED, KEPT_BACK = np.arange(0, 30), np.arange(30, 50)


def chosen(space: PoseSpace, tolerance: float = 0.1, most: int = 60, **more: object) -> RulePath:
    options = FitOptions.model_validate({"tolerance": tolerance, "max_points": most} | more)
    return choose_on_mesh(space, PoseSplit(FITTED, KEPT_BACK, 50), options)


@pytest.fixture(scope="module")
def space() -> PoseSpace:
    p = latent_problem(beam_scene((6, 2, 2), "tet4"), r=4, k=9, count=50)
    poses = (p.decoder(p.z) @ p.U.T).reshape(50, -1, 3)
    stiffness = reduced_rest_stiffness(p.scene, p.space().reduced_basis)
    return PoseSpace(p.space(), stiffness, p.z, lambda t: 1.02 * poses[t], threads=1)


def test_poses_to_fit_and_to_judge_are_disjoint_and_rise() -> None:
    fitted, kept_back = split_poses(100, 60, 40, seed=3)
    assert sorted([*fitted, *kept_back]) == list(range(100))
    assert (np.diff(fitted) > 0).all()
    assert (np.diff(kept_back) > 0).all()


def test_fewer_poses_than_asked_for_are_refused() -> None:
    with pytest.raises(SolverError, match="needs 60 poses to fit and 41 to judge, but there are 100"):
        split_poses(100, 60, 41, seed=3)


def test_a_short_motion_is_shared_out_as_a_long_one_would_be() -> None:
    split = PoseSplit.of(60, 60, CubatureOptions(poses=400, heldout_poses=200))
    assert (len(split.fitted), len(split.kept_back)) == (40, 20)
    assert not set(split.fitted) & set(split.kept_back)
    with pytest.raises(SolverError, match="needs 1 poses to fit and 1 to judge, but there are 1"):
        PoseSplit.of(1, 1, CubatureOptions())


def test_perturbed_poses_are_so_many_deviations_away() -> None:
    z = np.random.default_rng(0).standard_normal((4000, 3)) * [1.0, 10.0, 100.0]
    moved = perturbed(z, np.arange(4000), 0.2, (1,)) - z
    assert np.allclose(moved.std(axis=0), 0.2 * z.std(axis=0), rtol=0.05)


def test_every_rule_is_judged_on_poses_that_the_fit_did_not_see(space: PoseSpace) -> None:
    rules = chosen(space, norm="force").rules
    judge = ForceTerm(space, space.samples(space.z[KEPT_BACK], KEPT_BACK))
    assert np.allclose([rule.heldout_error for rule in rules], relative_errors(judge, rules), rtol=1e-10)
    assert rules[-1].heldout_error < 0.3
    assert np.isfinite([rule.perturbed_error for rule in rules]).all()
    assert rules[-1].perturbed_error != rules[-1].heldout_error


def test_a_rule_fitted_in_the_space_of_the_basis_is_judged_in_the_latent_one(space: PoseSpace) -> None:
    latent, linear = (chosen(space, 1e-6, 12, project=project).best for project in ("latent", "linear"))
    assert len(linear.points) == len(latent.points) == 12
    assert latent.heldout_error < linear.heldout_error


def test_a_closure_to_stronger_poses_makes_the_weights_heavier(space: PoseSpace) -> None:
    plain, closed = (chosen(space, 0.05, terms={"volume": 0.0, "closure": share}).best for share in (0.0, 1.0))
    assert 1.01 < closed.weights.sum() / plain.weights.sum() < 1.2


def test_few_candidates_cost_points_and_not_the_tolerance(space: PoseSpace) -> None:
    every, some = chosen(space), chosen(space, candidates=40)
    assert every.meets(0.1)
    assert some.meets(0.1)
    assert len(some.best.points) >= len(every.best.points)
