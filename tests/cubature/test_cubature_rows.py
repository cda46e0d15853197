"""Changes of force and energies against dense sums, the metric against its formula, and what they add to a fit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.cubature.candidates import System
from ldsim.cubature.fit import fit
from ldsim.cubature.forces import ProjectedForces
from ldsim.cubature.goal import Goal
from ldsim.cubature.metric import rest_compliance
from ldsim.cubature.rows import Energies, ForceChanges
from ldsim.dynamics.reduced.stepper import reduced_rest_stiffness
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder
from tests.cubature.cubature_problems import (
    Problem,
    beam_scene,
    latent_problem,
    point_energies,
    two_materials,
)

Array = NDArray[np.float64]

POSES = 12


@pytest.fixture(scope="module")
def case() -> Problem:
    return latent_problem(two_materials(beam_scene((4, 2, 2), "tet4")), r=4, k=9, count=POSES)


@pytest.fixture(scope="module")
def steps(case: Problem) -> Array:
    return 0.01 * np.random.default_rng(3).standard_normal(case.z.shape)


@pytest.fixture(scope="module")
def changes(case: Problem, steps: Array) -> ForceChanges:
    z = np.concatenate([case.z + steps, case.z - steps])
    return ForceChanges(ProjectedForces(case.scene, case.U, case.decoder, z, memory=0), POSES)


def test_the_rows_are_normalised_differences_of_forces(case: Problem, steps: Array, changes: ForceChanges) -> None:
    ahead = ProjectedForces(case.scene, case.U, case.decoder, case.z + steps)
    behind = ProjectedForces(case.scene, case.U, case.decoder, case.z - steps)
    points = np.arange(ahead.n_points)

    def shares(forces: ProjectedForces) -> Array:
        return forces.columns(points).reshape(POSES, 4, -1) * forces.scales[:, None, None]

    dense = shares(ahead) - shares(behind)
    norms = np.linalg.norm(dense.sum(axis=2), axis=1)
    dense = (dense / np.maximum(norms, 0.05 * np.median(norms))[:, None, None]).reshape(-1, len(points))
    assert np.allclose(changes.columns(points), dense, rtol=0, atol=1e-9 * np.abs(dense).max())
    assert np.allclose(changes.target, dense.sum(axis=1), atol=1e-9)
    residual = np.random.default_rng(4).standard_normal(len(dense))
    assert np.allclose(changes.correlations(residual), dense.T @ residual, rtol=0, atol=1e-9 * np.abs(dense).max())


def test_a_change_of_force_is_the_curvature_of_the_energy(case: Problem, steps: Array) -> None:
    # dᵀ(f(z + d) − f(z − d)) and half of V(z + 2d) − 2 V(z) + V(z − 2d) are both 2 dᵀ∇²V d up to O(d⁴).
    forces = ProjectedForces(case.scene, case.U, case.decoder, np.concatenate([case.z + steps, case.z - steps]))
    points = np.arange(forces.n_points)
    shares = forces.columns(points).reshape(2 * POSES, 4, -1) * forces.scales[:, None, None]
    change = np.einsum("tr,trs->ts", steps, shares[:POSES] - shares[POSES:])

    def energies(z: Array) -> Array:
        return np.array([point_energies(case, u) for u in case.decoder(z) @ case.U.T])

    curvature = 0.5 * (energies(case.z + 2 * steps) - 2 * energies(case.z) + energies(case.z - 2 * steps))
    assert np.abs(change - curvature).max() < 5e-3 * np.abs(curvature).max()


def test_a_pair_with_an_inverted_pose_is_left_out() -> None:
    case = latent_problem(beam_scene((4, 2, 2), "tet4", "neo_hookean"), r=4, k=9, count=POSES)
    z = 0.1 * case.z
    both = np.concatenate([z + 0.001, z - 0.001])
    good = np.delete(np.arange(2 * POSES), [3, POSES + 3])
    both[POSES + 3] *= 1e4
    changes = ForceChanges(ProjectedForces(case.scene, case.U, case.decoder, both), POSES)
    expected = ForceChanges(ProjectedForces(case.scene, case.U, case.decoder, both[good]), POSES - 1)
    assert np.allclose(changes.target, expected.target, rtol=1e-6, atol=1e-9)
    residual = np.random.default_rng(5).standard_normal(len(expected.target))
    assert np.allclose(changes.correlations(residual), expected.correlations(residual), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("threads", [1, 3])
def test_energy_rows_agree_with_a_sum_by_einsum(case: Problem, threads: int) -> None:
    rows = Energies(case.scene, case.U, case.decoder, case.z, threads=threads)
    dense = np.array([point_energies(case, u) for u in case.decoder(case.z) @ case.U.T])
    total = dense.sum(axis=1)
    dense /= np.maximum(total, 0.05 * np.median(total))[:, None]
    points = np.random.default_rng(6).permutation(rows.n_points)
    residual = np.random.default_rng(7).standard_normal(POSES)
    assert np.allclose(rows.columns(points), dense[:, points], rtol=1e-10, atol=1e-14)
    assert np.allclose(rows.target, dense.sum(axis=1), rtol=1e-10)
    assert np.allclose(rows.correlations(residual), dense.T @ residual, rtol=1e-10, atol=1e-12)


def test_a_system_of_several_kinds_of_rows_is_one_matrix(case: Problem, changes: ForceChanges) -> None:
    forces = ProjectedForces(case.scene, case.U, case.decoder, case.z, memory=0)
    system = System(forces, 0.3, ((changes, 0.5), (Energies(case.scene, case.U, case.decoder, case.z), 2.0)))
    points = np.arange(system.n_points)
    matrix, residual = system.columns(points), np.random.default_rng(8).standard_normal(len(system.target))
    assert np.allclose(matrix.sum(axis=1), system.target, rtol=0, atol=1e-9)
    correlations = matrix.T @ residual
    assert np.allclose(system.correlations(residual), correlations, rtol=0, atol=1e-9 * np.abs(correlations).max())
    lengths = [np.linalg.norm(part) for part in np.split(system.target, [48, 96, 108])]
    assert np.allclose(np.array(lengths) / lengths[0], [1.0, 0.5, 2.0, 0.3])


def test_fitting_tangents_and_energies_too_lowers_their_error(case: Problem, changes: ForceChanges) -> None:
    forces = ProjectedForces(case.scene, case.U, case.decoder, case.z)
    energies = Energies(case.scene, case.U, case.decoder, case.z)

    def error(rows: ForceChanges | Energies, *others: tuple[ForceChanges | Energies, float]) -> float:
        best = fit(forces, Goal(1e-3, 14), others=others).best
        multipliers = best.weights / rows.point_weights[best.points]
        residual = rows.columns(best.points) @ multipliers - rows.target
        return float(np.linalg.norm(residual) / np.linalg.norm(rows.target))

    assert error(changes, (changes, 2.0)) < 0.9 * error(changes)
    assert error(energies, (energies, 2.0)) < 0.9 * error(energies)


def test_the_rest_compliance_inverts_the_mean_stiffness_of_the_latent_space(case: Problem) -> None:
    stiffness = reduced_rest_stiffness(case.scene, Basis.of(case.U, case.scene.mass))
    W = rest_compliance(stiffness, case.decoder, case.z)
    mean = np.mean([J.T @ stiffness @ J for J in map(case.decoder.jacobian, case.z)], axis=0)
    assert np.allclose(W @ W.T @ mean, np.eye(4), atol=1e-8)


def test_in_the_compliance_norm_a_change_of_latent_units_changes_nothing() -> None:
    case = latent_problem(beam_scene((4, 2, 2), "tet4"), r=4, k=9, count=POSES)
    linear = Decoder.identity(9)
    q = case.decoder(case.z)
    stiffness = reduced_rest_stiffness(case.scene, Basis.of(case.U, case.scene.mass))
    turn = np.linalg.qr(np.random.default_rng(9).standard_normal((9, 9)))[0] * np.logspace(-1, 1, 9)
    turned = case.U @ np.linalg.inv(turn).T
    one = ProjectedForces(case.scene, case.U, linear, q, metric=rest_compliance(stiffness, linear, q))
    other_stiffness = reduced_rest_stiffness(case.scene, Basis.of(turned, case.scene.mass))
    metric = rest_compliance(other_stiffness, linear, q @ turn)
    other = ProjectedForces(case.scene, turned, linear, q @ turn, metric=metric)
    points = np.arange(one.n_points)
    left, right = one.columns(points), other.columns(points)
    gram = left.T @ left
    assert np.abs(right.T @ right - gram).max() < 1e-8 * np.abs(gram).max()
    assert np.allclose(right.T @ other.target, left.T @ one.target, rtol=0, atol=1e-8 * np.abs(gram).max())
