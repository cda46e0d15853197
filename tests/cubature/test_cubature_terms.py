"""Changes of force and energies against dense sums, the metric against its formula, and what they add to a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.cubature.methods import fit
from ldsim.cubature.options import FitOptions
from ldsim.cubature.samples import rest_compliance
from ldsim.cubature.system import System
from ldsim.cubature.terms import EnergyTerm, ForceTerm, TangentTerm
from ldsim.dynamics.reduced.matrices import reduced_rest_stiffness
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


@pytest.fixture(autouse=True)
def no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """No stresses are kept in float32, whose rounding these tests would see."""
    monkeypatch.setattr("ldsim.cubature.terms.MEMORY", 0)


@pytest.fixture(scope="module")
def case() -> Problem:
    return latent_problem(two_materials(beam_scene((4, 2, 2), "tet4")), r=4, k=9, count=POSES)


@pytest.fixture(scope="module")
def steps(case: Problem) -> Array:
    return 0.01 * np.random.default_rng(3).standard_normal(case.z.shape)


@pytest.fixture(scope="module")
def changes(case: Problem, steps: Array) -> TangentTerm:
    z = np.concatenate([case.z + steps, case.z - steps])
    return TangentTerm(case.forces(z), POSES)


def energies_of(case: Problem, threads: int = 1) -> EnergyTerm:
    space = case.poses(threads=threads)
    return EnergyTerm(space, space.samples(space.z, np.arange(POSES)))


def test_a_tangent_is_normalised_differences_of_forces(case: Problem, steps: Array, changes: TangentTerm) -> None:
    ahead, behind = case.forces(case.z + steps), case.forces(case.z - steps)
    points = np.arange(len(ahead.point_weights))

    def shares(forces: ForceTerm) -> Array:
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
    forces = case.forces(np.concatenate([case.z + steps, case.z - steps]))
    points = np.arange(len(forces.point_weights))
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
    changes = TangentTerm(case.forces(both), POSES)
    expected = TangentTerm(case.forces(both[good]), POSES - 1)
    assert np.allclose(changes.target, expected.target, rtol=1e-6, atol=1e-9)
    residual = np.random.default_rng(5).standard_normal(len(expected.target))
    assert np.allclose(changes.correlations(residual), expected.correlations(residual), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("threads", [1, 3])
def test_energies_agree_with_a_sum_by_einsum(case: Problem, threads: int) -> None:
    term = energies_of(case, threads)
    dense = np.array([point_energies(case, u) for u in case.decoder(case.z) @ case.U.T])
    total = dense.sum(axis=1)
    dense /= np.maximum(total, 0.05 * np.median(total))[:, None]
    points = np.random.default_rng(6).permutation(len(term.point_weights))
    residual = np.random.default_rng(7).standard_normal(POSES)
    assert np.allclose(term.columns(points), dense[:, points], rtol=1e-10, atol=1e-14)
    assert np.allclose(term.target, dense.sum(axis=1), rtol=1e-10)
    assert np.allclose(term.correlations(residual), dense.T @ residual, rtol=1e-10, atol=1e-12)


def test_a_system_of_several_terms_is_one_matrix(case: Problem, changes: TangentTerm) -> None:
    system = System(case.forces(), 0.3, ((changes, 0.5), (energies_of(case), 2.0)))
    points = np.arange(system.n_points)
    matrix, residual = system.columns(points), np.random.default_rng(8).standard_normal(len(system.target))
    assert np.allclose(matrix.sum(axis=1), system.target, rtol=0, atol=1e-9)
    correlations = matrix.T @ residual
    assert np.allclose(system.correlations(residual), correlations, rtol=0, atol=1e-9 * np.abs(correlations).max())
    lengths = [np.linalg.norm(part) for part in np.split(system.target, [48, 96, 108])]
    assert np.allclose(np.array(lengths) / lengths[0], [1.0, 0.5, 2.0, 0.3])


def test_fitting_tangents_and_energies_too_lowers_their_error(case: Problem, changes: TangentTerm) -> None:
    forces, energies = case.forces(), energies_of(case)

    def error(term: TangentTerm | EnergyTerm, *others: tuple[TangentTerm | EnergyTerm, float]) -> float:
        best = fit(System(forces, 0.3, others), FitOptions(tolerance=1e-3, max_points=14)).best
        multipliers = best.weights / term.point_weights[best.points]
        residual = term.columns(best.points) @ multipliers - term.target
        return float(np.linalg.norm(residual) / np.linalg.norm(term.target))

    assert error(changes, (changes, 2.0)) < 0.9 * error(changes)
    assert error(energies, (energies, 2.0)) < 0.9 * error(energies)


def test_the_rest_compliance_inverts_the_mean_stiffness_of_the_latent_space(case: Problem) -> None:
    stiffness = reduced_rest_stiffness(case.scene, case.space().reduced_basis)
    W = rest_compliance(stiffness, case.decoder, case.z)
    mean = np.mean([J.T @ stiffness @ J for J in map(case.decoder.jacobian, case.z)], axis=0)
    assert np.allclose(W @ W.T @ mean, np.eye(4), atol=1e-8)


def test_in_the_compliance_norm_a_change_of_latent_units_changes_nothing() -> None:
    case = latent_problem(beam_scene((4, 2, 2), "tet4"), r=4, k=9, count=POSES)
    linear = Decoder.identity(9)
    q = case.decoder(case.z)
    stiffness = reduced_rest_stiffness(case.scene, case.space().reduced_basis)
    turn = np.linalg.qr(np.random.default_rng(9).standard_normal((9, 9)))[0] * np.logspace(-1, 1, 9)
    turned = case.U @ np.linalg.inv(turn).T
    plain = replace(case, decoder=linear, z=q)
    one = plain.forces(metric=rest_compliance(stiffness, linear, q))
    other_stiffness = reduced_rest_stiffness(case.scene, Basis.of(turned, case.scene.mass))
    metric = rest_compliance(other_stiffness, linear, q @ turn)
    other = replace(plain, U=turned, z=q @ turn).forces(metric=metric)
    points = np.arange(len(one.point_weights))
    left, right = one.columns(points), other.columns(points)
    gram = left.T @ left
    assert np.abs(right.T @ right - gram).max() < 1e-8 * np.abs(gram).max()
    assert np.allclose(right.T @ other.target, left.T @ one.target, rtol=0, atol=1e-8 * np.abs(gram).max())
