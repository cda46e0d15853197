"""The metric of forces against its formula, and forces and volume as one system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldsim.cubature.samples import rest_compliance
from ldsim.cubature.system import System
from ldsim.dynamics.reduced.matrices import reduced_rest_stiffness
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder
from tests.cubature.cubature_problems import Problem, beam_scene, latent_problem, two_materials

POSES = 12


@pytest.fixture(scope="module")
def case() -> Problem:
    return latent_problem(two_materials(beam_scene((4, 2, 2), "tet4")), r=4, k=9, count=POSES)


def test_a_system_of_forces_and_volume_is_one_matrix(case: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldsim.cubature.terms.MEMORY", 0)  # stresses kept in float32 would round
    system = System(case.forces(), 0.3)
    matrix, residual = system.columns(np.arange(system.n_points)), np.random.default_rng(8).standard_normal(49)
    assert np.allclose(matrix.sum(axis=1), system.target, rtol=0, atol=1e-9)
    correlations = matrix.T @ residual
    assert np.allclose(system.correlations(residual), correlations, rtol=0, atol=1e-9 * np.abs(correlations).max())
    forces, volume = (float(np.linalg.norm(part)) for part in np.split(system.target, [48]))
    assert volume == pytest.approx(0.3 * forces)


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
