"""The fits of a condensed space: exact at rest, never negative, and the compiled potential is the fitted one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.cubature.kernels import stresses_of_strains
from ldsim.errors import SolverError
from ldsim.learn.condensed import HELD, Condensed, CondensedSamples, _Fit, fit_condensed
from ldsim.learn.options import CondensedOptions, TrainOptions
from ldsim.mechanics.elastic import Elements
from ldsim.mechanics.materials import material_number

R, K, POINTS = 2, 3, 6
S0 = np.array([[4.0, 1.0], [1.0, 9.0]])
T0 = np.array([[0.3, 0.0, -0.1], [0.1, 0.2, 0.4]])
OPTIONS = TrainOptions(
    kind="condensed", hidden=(16,), condensed=CondensedOptions(points=POINTS, features=4, columns=K, steps=400)
)


def stiffening(z: Array) -> tuple[Array, Array]:
    """Gradient and Hessian of ½ zᵀS₀z + ¼ (zᵀS₀z)²: harder the farther it is bent."""
    image, energy = S0 @ z, z @ S0 @ z
    return (1 + energy) * image, (1 + energy) * S0 + 2 * np.outer(image, image)


def samples(count: int = 200) -> CondensedSamples:
    rng = np.random.default_rng(0)
    z = 0.2 * rng.normal(size=(count, R))
    derivatives = [stiffening(row) for row in z]
    directions = 0.1 * rng.normal(size=(count, 2, R))
    C = rng.normal(size=(R, R, K))
    slaved = np.einsum("ni,nj,ijk->nk", z, z, C)
    along = np.einsum("ndi,nj,ijk->ndk", directions, z, C + C.transpose(1, 0, 2))
    force, stiffness = (np.array([pair[i] for pair in derivatives]) for i in (0, 1))
    slaved, along = slaved + z @ T0, along + directions @ T0
    return CondensedSamples(z, force, stiffness, slaved, directions, along, S0, T0)


MU, LAM = np.full(POINTS, 2e4), np.full(POINTS, 3e4)


@pytest.fixture(scope="module")
def fitted() -> Condensed:
    return fit_condensed(samples(), (np.arange(POINTS), MU, LAM), OPTIONS, lambda *seen: None)


def gradient(found: Condensed, z: Array) -> Array:
    """∇V_eff by the compiled material at the points of the rule."""
    rule, J = found.potential, found.decoder.jacobian(z)
    assert rule.maps is not None and rule.material == material_number("stable_neo_hookean")
    none = np.zeros((POINTS, 4), dtype=np.int32), np.zeros((POINTS, 4, 3)), np.zeros(POINTS)
    elements = Elements(*none, np.full(POINTS, rule.material, dtype=np.int8), MU, LAM)
    strains = (rule.maps @ found.decoder(z))[None]
    stresses = np.empty_like(strains)
    assert not stresses_of_strains(elements, strains, rule.weights, stresses)  # it is finite
    force: Array = J.T @ np.einsum("sij,si->j", rule.maps, stresses[0])
    return force


def test_the_compiled_potential_has_the_fitted_forces(fitted: Condensed) -> None:
    data, (values, vectors) = samples(), np.linalg.eigh(S0)
    to_energy = vectors / np.sqrt(values)  # λ̃ = S₀^(−½) λ, as the fit measures forces

    def off(z: Array, force: Array) -> float:
        return float(np.linalg.norm((gradient(fitted, z) - force) @ to_energy))

    errors = [off(z, f) / np.linalg.norm(f @ to_energy) for z, f in zip(data.z, data.force, strict=True)]
    assert np.median(errors) < 0.02
    # the same number, but for some poses that the fit kept back
    assert np.median(errors) == pytest.approx(fitted.potential.training_error, rel=0.3)


def test_rest_is_at_rest(fitted: Condensed) -> None:
    np.testing.assert_array_equal(fitted.decoder(np.zeros(R)), 0)
    np.testing.assert_allclose(gradient(fitted, np.zeros(R)), 0, atol=1e-9)


@pytest.mark.parametrize("activation", ["elu", "tanh", "sigmoid", "relu"])
def test_at_rest_stiffness_and_tangents_are_exact_however_little_was_learned(activation: str) -> None:
    options = OPTIONS.replace(activation=activation, condensed=OPTIONS.condensed.replace(steps=3))
    found = fit_condensed(samples(), (np.arange(POINTS), MU, LAM), options, lambda *seen: None)
    np.testing.assert_allclose(found.decoder.jacobian(np.zeros(R))[-K:], T0.T, atol=1e-12)
    h = 1e-5
    for axis in np.eye(R):
        change = gradient(found, h * axis) - gradient(found, -h * axis)
        np.testing.assert_allclose(change / (2 * h), S0 @ axis, rtol=1e-4, atol=1e-4)


def test_outside_the_samples_the_energy_is_finite_and_pulls_back(fitted: Condensed) -> None:
    for direction in np.random.default_rng(1).normal(size=(20, R)):
        for radius in (0.5, 1.0, 3.0, 10.0):  # in units of which a sample has a fifth
            z = radius * direction / np.linalg.norm(direction)
            assert gradient(fitted, z) @ z > 0


def test_the_decoder_begins_with_its_own_coordinates_and_the_encoder_takes_them(fitted: Condensed) -> None:
    z = samples().z
    q = fitted.decoder(z)
    np.testing.assert_allclose(q[:, :R], z, atol=1e-12)
    np.testing.assert_allclose(fitted.encoder(q), z, atol=1e-12)
    slaved = samples().slaved
    off = np.linalg.norm(q[:, -K:] - slaved, axis=1) / np.linalg.norm(slaved, axis=1)
    assert np.median(off) < 0.1


def test_the_same_seed_gives_the_same_model(fitted: Condensed) -> None:
    again = fit_condensed(samples(), (np.arange(POINTS), MU, LAM), OPTIONS, lambda *seen: None)
    np.testing.assert_array_equal(again.decoder.layers.weights, fitted.decoder.layers.weights)
    np.testing.assert_array_equal(again.potential.weights, fitted.potential.weights)


def test_too_few_poses_are_refused() -> None:
    with pytest.raises(SolverError, match="only 5 relaxed poses"):
        fit_condensed(samples(5), (np.arange(POINTS), MU, LAM), OPTIONS, lambda *seen: None)


def test_a_wrong_force_counts_by_how_far_it_moves_the_solid_held() -> None:
    """Where it is stiff less, where it is soft more, and where it buckles by what holds it."""
    content = samples(20)
    stiff, soft, buckled = 9.0, 0.1, -0.5  # shares of S₀
    stiffness = content.stiffness.copy()
    root = np.linalg.cholesky(S0)
    for i, (a, b) in enumerate([(stiff, soft), (soft, buckled)]):
        stiffness[i] = root @ np.diag([a, b]) @ root.T
    fit = _Fit(replace(content, stiffness=stiffness), (np.arange(POINTS), MU, LAM), OPTIONS)
    expected = 1 / (np.abs([[soft, stiff], [buckled, soft]]) + HELD)
    found = np.linalg.eigvalsh(fit.softness[:2])
    np.testing.assert_allclose(found, np.sort(expected, axis=1), rtol=1e-5)
    moved = fit.softness[0] @ np.linalg.eigh(fit.hessian[0])[1]
    assert np.linalg.norm(moved[:, 0]) > 20 * np.linalg.norm(moved[:, 1])


def test_the_gradient_of_the_loss_is_that_of_differences() -> None:
    fit = _Fit(samples(20), (np.arange(POINTS), MU, LAM), OPTIONS)
    for name in ("y", "force", "hessian", "softness", "slaved", "along", "directions"):
        setattr(fit, name, getattr(fit, name).astype(np.float64))
    fit.model, rng = fit.model.in_precision(np.float64), np.random.default_rng(2)
    batch, v, one = rng.integers(20, size=7), rng.normal(size=(7, R)), rng.integers(2, size=7)
    for parameter in fit.model.parameters:
        parameter += 0.1 * rng.normal(size=parameter.shape)
    _, gradient = fit._gradient(batch, v, one)
    h = 1e-6
    for parameter, slope in zip(fit.model.parameters, gradient, strict=True):
        direction = rng.normal(size=parameter.shape)
        parameter += h * direction
        above, _ = fit._gradient(batch, v, one)
        parameter -= 2 * h * direction
        change = (above - fit._gradient(batch, v, one)[0]) / (2 * h)
        parameter += h * direction
        assert (slope * direction).sum() == pytest.approx(change, rel=1e-5, abs=1e-7)


def test_a_loss_that_is_not_finite_and_maps_that_are_singular_are_told() -> None:
    fit = _Fit(samples(20), (np.arange(POINTS), MU, LAM), OPTIONS)
    fit.model.weights[0][:] = np.nan
    with pytest.raises(SolverError, match="the loss of the condensed space is nan; relax more poses"):
        fit.step(0)
    fit = _Fit(samples(20), (np.arange(POINTS), MU, LAM), OPTIONS)
    fit.model.maps[:] = 0.0
    with pytest.raises(SolverError, match="strain maps of the condensed space have become singular"):
        fit.step(0)
