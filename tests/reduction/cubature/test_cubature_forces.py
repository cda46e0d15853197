"""Projected forces against a dense, independent computation: energies differenced numerically, no stress formula."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.mechanics.materials import energy
from ldsim.reduction.cubature.forces import ProjectedForces
from ldsim.reduction.decoder import Decoder
from tests.reduction.cubature.cubature_problems import Problem, beam_scene, latent_problem, linear_problem, smooth_poses

Array = NDArray[np.float64]

PROBLEMS = {
    "linear tet4": lambda: linear_problem(beam_scene((4, 2, 2), "tet4"), k=6, count=20),
    "latent tet4": lambda: latent_problem(beam_scene((4, 2, 2), "tet4"), r=4, k=9, count=20),
    "latent hex8": lambda: latent_problem(beam_scene((3, 2, 1), "hex8"), r=4, k=9, count=20),
}


@cache
def problem(name: str) -> Problem:
    return PROBLEMS[name]()


@pytest.fixture(params=PROBLEMS)
def case(request: pytest.FixtureRequest) -> Problem:
    return problem(request.param)


def forces_of(p: Problem, **options: object) -> ProjectedForces:
    return ProjectedForces(p.scene, p.U, p.decoder, p.z, **options)


def point_energies(p: Problem, u: Array) -> Array:
    """w_s Ψ(F_s), (s,), with F by einsum."""
    e = p.scene.elements
    F = np.eye(3) + np.einsum("sai,saj->sij", u.reshape(-1, 3)[e.nodes], e.gradients)
    densities = [
        energy(kind, tuple(f.ravel()), mu, lam) for kind, f, mu, lam in zip(e.kind, F, e.mu, e.lam, strict=True)
    ]
    return e.weights * np.array(densities)


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


@pytest.mark.parametrize("floor", [0.05, 1.0])
def test_columns_target_and_correlations_agree_with_differenced_energies(case: Problem, floor: float) -> None:
    forces = forces_of(case, floor=floor)
    dense = normalised(dense_shares(case, case.decoder(case.z) @ case.U.T), floor)
    residual = np.random.default_rng(1).standard_normal(len(dense))
    points = np.random.default_rng(2).permutation(forces.n_points)
    size = np.abs(dense).max()
    assert np.abs(forces.columns(points) - dense[:, points]).max() < 1e-6 * size
    assert np.abs(forces.target - dense.sum(axis=1)).max() < 1e-6
    correlations = dense.T @ residual
    assert np.abs(forces.correlations(residual) - correlations).max() < 1e-6 * np.abs(correlations).max()


def test_true_poses_are_projected_with_the_jacobian_of_the_latent_ones() -> None:
    case = problem("latent tet4")
    true = smooth_poses(case.scene, len(case.z), seed=7)
    forces = forces_of(case, displacement=lambda t: true[t].reshape(-1, 3))
    dense = normalised(dense_shares(case, true), 0.05)
    assert np.abs(forces.columns(np.arange(forces.n_points)) - dense).max() < 1e-6 * np.abs(dense).max()
    assert np.abs(forces.target - forces_of(case).target).max() > 0.1


def test_all_columns_sum_to_the_target(case: Problem) -> None:
    forces = forces_of(case)
    assert np.allclose(forces.columns(np.arange(forces.n_points)).sum(axis=1), forces.target, rtol=0, atol=1e-13)


@pytest.mark.parametrize("poses_that_fit", [0, 7, 20])
def test_stored_and_recomputed_stresses_give_the_same_correlations(case: Problem, poses_that_fit: int) -> None:
    memory = poses_that_fit * case.scene.points.n_points * 36
    forces = forces_of(case, memory=memory)
    residual = np.random.default_rng(3).standard_normal(len(forces.target))
    exact = forces.columns(np.arange(forces.n_points)).T @ residual
    limit = 1e-12 if poses_that_fit == 0 else 1e-6
    assert np.abs(forces.correlations(residual) - exact).max() < limit * np.abs(exact).max()


def test_no_pose_weighs_more_than_one_and_those_near_rest_weigh_less() -> None:
    case = problem("linear tet4")
    z = case.z.copy()
    z[0] *= 1e-6
    z[1] = 0.0
    norms = np.linalg.norm(forces_of(replace(case, z=z)).target.reshape(len(z), -1), axis=1)
    assert np.allclose(norms[2:], 1.0)
    assert 0 < norms[0] < 1e-3
    assert norms[1] < 1e-12


def test_inverted_poses_are_left_out_and_counted() -> None:
    scene = beam_scene((4, 2, 2), "tet4", "neo_hookean")
    case = linear_problem(scene, k=6, count=20)
    z = case.z.copy() * 0.1
    bad = [0, 8]
    good = np.delete(np.arange(20), bad)
    z[bad] *= 1e4
    forces, expected = forces_of(replace(case, z=z)), forces_of(replace(case, z=z[good]))
    assert (forces.dropped, forces.n_poses) == (2, 18)
    residual = np.random.default_rng(4).standard_normal(len(expected.target))
    points = np.array([5, 3])
    assert np.array_equal(forces.target, expected.target)
    assert np.array_equal(forces.columns(points), expected.columns(points))
    assert np.array_equal(forces.correlations(residual), expected.correlations(residual))
    poses = (z @ case.U.T).reshape(len(z), -1, 3)
    true = forces_of(replace(case, z=z), displacement=lambda t: poses[t], memory=0)
    assert np.allclose(true.correlations(residual), expected.correlations(residual), rtol=1e-5)


def bad_inputs() -> dict[str, tuple[Problem, dict[str, object], str]]:
    case = problem("linear tet4")
    hookean = replace(case, scene=beam_scene((4, 2, 2), "tet4", "neo_hookean"))
    short = np.zeros((3, 3))
    return {
        "basis of another mesh": (replace(case, U=case.U[:-3]), {}, "basis has shape"),
        "decoder of another basis": (replace(case, decoder=Decoder.identity(5)), {}, "basis has shape"),
        "poses of another dimension": (replace(case, z=case.z[:, 1:]), {}, "poses have shape"),
        "no poses": (replace(case, z=case.z[:0]), {}, "poses have shape"),
        "floor of zero": (case, {"floor": 0.0}, "floor is 0"),
        "only poses at rest": (replace(case, z=0 * case.z), {}, "is zero"),
        "only inverted poses": (replace(hookean, z=1e4 * case.z), {}, "infinite energy"),
        "true poses of another mesh": (case, {"displacement": lambda t: short}, "displacement of pose 0"),
    }


@pytest.mark.parametrize("name", bad_inputs())
def test_bad_input_is_refused_in_one_line(name: str) -> None:
    bad, options, words = bad_inputs()[name]
    with pytest.raises(SolverError, match=words) as caught:
        forces_of(bad, **options)
    assert "\n" not in str(caught.value)
