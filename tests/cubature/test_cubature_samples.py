"""Projected forces against a dense, independent computation: energies differenced numerically, no stress formula."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.cubature.choose import closed_samples
from ldsim.cubature.options import FitOptions, TermOptions
from ldsim.cubature.samples import PoseSpace, Samples
from ldsim.cubature.terms import ForceTerm
from ldsim.errors import SolverError
from ldsim.space.decoder import Decoder
from ldsim.space.lifting import Lifting
from tests.cubature.cubature_problems import (
    Problem,
    beam_scene,
    forces_of,
    latent_problem,
    linear_problem,
    point_energies,
    smooth_poses,
    two_materials,
)

Array = NDArray[np.float64]

PROBLEMS = {
    "linear tet4": lambda: linear_problem(beam_scene((4, 2, 2), "tet4"), k=6, count=20),
    "latent tet4": lambda: latent_problem(beam_scene((4, 2, 2), "tet4"), r=4, k=9, count=20),
    "latent hex8": lambda: latent_problem(beam_scene((3, 2, 1), "hex8"), r=4, k=9, count=20),
    "two materials": lambda: latent_problem(two_materials(beam_scene((4, 2, 2), "tet4")), r=4, k=9, count=20),
}


@cache
def problem(name: str) -> Problem:
    return PROBLEMS[name]()


@pytest.fixture(params=PROBLEMS)
def case(request: pytest.FixtureRequest) -> Problem:
    return problem(request.param)


def dense_shares(p: Problem, poses: Array, step: float = 1e-5) -> Array:
    """b_st by central differences of each point's energy along the columns of U J(z_t), (T, r, s)."""
    shares = np.empty((len(poses), p.decoder.r, p.scene.points.n_points))
    for t, u in enumerate(poses):
        for i, direction in enumerate((p.U @ p.decoder.jacobian(p.z[t])).T):
            h = step / np.abs(direction).max()
            shares[t, i] = (point_energies(p, u + h * direction) - point_energies(p, u - h * direction)) / (2 * h)
    return shares


def normalised(shares: Array, floor: float) -> Array:
    norms = np.linalg.norm(shares.sum(axis=2), axis=1)
    scaled = shares / np.maximum(norms, floor * np.median(norms))[:, None, None]
    return scaled.reshape(-1, shares.shape[2])


@pytest.mark.parametrize("memory", [0, 2**30])
def test_what_moving_pins_prescribe_is_in_the_poses_and_no_force_on_it_counts(
    memory: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ldsim.cubature.terms.MEMORY", memory)
    case, rng = problem("latent tet4"), np.random.default_rng(6)
    fields = np.tile(case.scene.mesh.vertices, (1, 2)).reshape(-1, 3, 2) @ rng.normal(size=(2, 5))
    L, a = fields.reshape(len(case.U), 5), 0.03 * rng.normal(size=(len(case.z), 5))
    lifted = case.space(Lifting(L, (), case.scene.pinned))
    forces = forces_of(replace(case.poses(), space=lifted, given=a))
    dense = normalised(dense_shares(case, case.decoder(case.z) @ case.U.T + a @ L.T), 0.05)
    residual, points = rng.standard_normal(len(dense)), np.arange(0, dense.shape[1], 3)
    assert np.abs(forces.columns(points) - dense[:, points]).max() < 1e-6 * np.abs(dense).max()
    assert np.abs(forces.target - dense.sum(axis=1)).max() < 1e-6
    correlations = dense.T @ residual
    assert np.abs(forces.correlations(residual) - correlations).max() < 1e-6 * np.abs(correlations).max()
    assert np.abs(forces.target - case.forces().target).max() > 1e-2


@pytest.mark.parametrize("floor", [0.05, 1.0])
def test_columns_target_and_correlations_agree_with_differenced_energies(
    case: Problem, floor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ldsim.cubature.samples.FLOOR", floor)
    forces = case.forces()
    dense = normalised(dense_shares(case, case.decoder(case.z) @ case.U.T), floor)
    residual = np.random.default_rng(1).standard_normal(len(dense))
    points = np.random.default_rng(2).permutation(dense.shape[1])
    size = np.abs(dense).max()
    assert np.abs(forces.columns(points) - dense[:, points]).max() < 1e-6 * size
    assert np.abs(forces.target - dense.sum(axis=1)).max() < 1e-6
    correlations = dense.T @ residual
    assert np.abs(forces.correlations(residual) - correlations).max() < 1e-6 * np.abs(correlations).max()


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_closure_moves_the_target_to_the_forces_of_the_true_poses_and_keeps_the_shares(share: float) -> None:
    case, count = problem("latent tet4"), 15
    true = smooth_poses(case.scene, count, seed=7)
    space = replace(case.poses(), displacement=lambda t: true[t].reshape(-1, 3))
    options = FitOptions(terms=TermOptions(closure=share))
    closed, rest = np.arange(count), np.arange(count, len(case.z))
    samples = Samples.joined(closed_samples(space, closed, options), space.samples(case.z[rest], rest))
    forces = ForceTerm(space, samples)
    decoded = dense_shares(case, case.decoder(case.z) @ case.U.T)
    aim = decoded.sum(axis=2)
    aim[:count] = (1 - share) * aim[:count] + share * dense_shares(case, true).sum(axis=2)
    norms = np.linalg.norm(aim, axis=1)
    scales = np.maximum(norms, 0.05 * np.median(norms))[:, None]
    assert np.abs(forces.target - (aim / scales).ravel()).max() < 1e-6
    columns = (decoded / scales[:, :, None]).reshape(-1, decoded.shape[2])
    assert np.abs(forces.columns(np.arange(columns.shape[1])) - columns).max() < 1e-6 * np.abs(columns).max()


def test_a_metric_changes_every_share_and_the_scale_of_each_pose(case: Problem) -> None:
    metric = np.random.default_rng(5).standard_normal((case.decoder.r, case.decoder.r))
    dense = dense_shares(case, case.decoder(case.z) @ case.U.T)
    turned = normalised(np.einsum("ri,trs->tis", metric, dense), 0.05)
    columns = case.forces(metric=metric).columns(np.arange(dense.shape[2]))
    assert np.abs(columns - turned).max() < 1e-6 * np.abs(turned).max()


def test_candidates_limit_the_correlations_and_nothing_else() -> None:
    case = problem("latent hex8")
    few = np.array([40, 3, 17])
    forces, some = case.forces(), case.forces(candidates=few)
    residual = np.random.default_rng(6).standard_normal(len(forces.target))
    expected = np.zeros(len(forces.point_weights))
    expected[few] = forces.correlations(residual)[few]
    assert np.allclose(some.correlations(residual), expected, rtol=1e-12)
    assert np.array_equal(some.target, forces.target)
    assert np.array_equal(some.columns(np.array([0, 5])), forces.columns(np.array([0, 5])))


def test_no_points_are_an_empty_matrix(case: Problem) -> None:
    forces = case.forces()
    assert forces.columns(np.empty(0, dtype=np.int64)).shape == (len(forces.target), 0)


def test_the_number_of_threads_changes_no_bit(case: Problem) -> None:
    one, four = (forces_of(case.poses(threads=threads)) for threads in (1, 4))
    residual = np.random.default_rng(7).standard_normal(len(one.target))
    points = np.arange(len(one.point_weights))
    assert np.array_equal(one.target, four.target)
    assert np.array_equal(one.correlations(residual), four.correlations(residual))
    assert np.array_equal(one.columns(points), four.columns(points))


def test_all_columns_sum_to_the_target(case: Problem) -> None:
    forces = case.forces()
    assert np.allclose(
        forces.columns(np.arange(len(forces.point_weights))).sum(axis=1), forces.target, rtol=0, atol=1e-13
    )


@pytest.mark.parametrize("poses_that_fit", [0, 7, 20])
def test_stored_and_recomputed_stresses_give_the_same_correlations(
    case: Problem, poses_that_fit: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ldsim.cubature.terms.MEMORY", poses_that_fit * case.scene.points.n_points * 36)
    forces = case.forces()
    residual = np.random.default_rng(3).standard_normal(len(forces.target))
    exact = forces.columns(np.arange(len(forces.point_weights))).T @ residual
    limit = 1e-12 if poses_that_fit == 0 else 1e-6
    assert np.abs(forces.correlations(residual) - exact).max() < limit * np.abs(exact).max()


def test_no_pose_weighs_more_than_one_and_those_near_rest_weigh_less() -> None:
    case = problem("linear tet4")
    z = case.z.copy()
    z[0] *= 1e-6
    z[1] = 0.0
    norms = np.linalg.norm(case.forces(z).target.reshape(len(z), -1), axis=1)
    assert np.allclose(norms[2:], 1.0)
    assert 0 < norms[0] < 1e-3
    assert norms[1] < 1e-12


def test_inverted_poses_are_left_out() -> None:
    scene = beam_scene((4, 2, 2), "tet4", "neo_hookean")
    case = linear_problem(scene, k=6, count=20)
    z = case.z.copy() * 0.1
    bad = [0, 8]
    good = np.delete(np.arange(20), bad)
    z[bad] *= 1e4
    forces, expected = case.forces(z), case.forces(z[good])
    assert forces.kept.tolist() == good.tolist()
    residual = np.random.default_rng(4).standard_normal(len(expected.target))
    points = np.array([5, 3])
    assert np.array_equal(forces.target, expected.target)
    assert np.array_equal(forces.columns(points), expected.columns(points))
    assert np.array_equal(forces.correlations(residual), expected.correlations(residual))
    poses = (z @ case.U.T).reshape(len(z), -1, 3)
    space = replace(case.poses(z), displacement=lambda t: poses[t])
    true = ForceTerm(space, closed_samples(space, np.arange(20), FitOptions(terms=TermOptions(closure=1.0))))
    assert np.allclose(true.target, expected.target, rtol=0, atol=1e-13)


def of_displacement(p: Problem, u: Array) -> PoseSpace:
    return replace(p.poses(), displacement=lambda t: u)


def bad_inputs() -> dict[str, tuple[Callable[[], object], str]]:
    case = problem("linear tet4")
    hookean = replace(case, scene=beam_scene((4, 2, 2), "tet4", "neo_hookean"))
    short = np.zeros((3, 3))
    return {
        "decoder of another basis": (
            replace(case, decoder=Decoder.identity(5)).forces,
            "the decoder gives 5 coordinates",
        ),
        "pins without their fields": (lambda: replace(case.poses(), given=np.zeros((20, 2))), "basis has shape"),
        "poses of another dimension": (lambda: case.forces(case.z[:, 1:]), "poses have shape"),
        "no poses": (lambda: case.forces(case.z[:0]), "poses have shape"),
        "only poses at rest": (lambda: case.forces(0 * case.z), "is zero"),
        "only inverted poses": (lambda: hookean.forces(1e4 * case.z), "infinite energy"),
        "true poses of another mesh": (
            lambda: of_displacement(case, short).true_forces(np.arange(3)),
            "displacement of pose 0",
        ),
    }


@pytest.mark.parametrize("name", bad_inputs())
def test_bad_input_is_refused_in_one_line(name: str) -> None:
    make, words = bad_inputs()[name]
    with pytest.raises(SolverError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)
