"""Modes that swing beside the coordinates of a condensed space: against dense matrices, and against full space."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import eigh, null_space

from ldsim.arrays import Array
from ldsim.cubature.rule import CubatureRule, strain_maps
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.matrices import reduced_mass, reduced_rest_stiffness
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.materials import material_number
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.pipeline.swing import swinging
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.modes import Modes, following, slowest_modes
from ldsim.space.pca import orthonormal_rows
from ldsim.space.relaxation import Relaxation
from ldsim.space.space import Space
from tests.helpers import scene, smooth_basis, unit_basis

R = 3
# Of loads, so that what turns and stretches around a grab is rounding.
SMALL = 1e-6


@cache
def body() -> Scene:
    """Linear, so that every one of its equilibria and modes is exact, and heavy beside a load that varies."""
    plain = scene(beam(resolution=1), "linear", youngs_modulus=3e4)
    return replace(plain, load=SMALL * 1e-4 * np.random.default_rng(4).normal(size=plain.mesh.vertices.shape))


@cache
def relaxation() -> Relaxation:
    return Relaxation(body(), Basis.of(smooth_basis(body(), R), body().mass))


@cache
def every_mode() -> Modes:
    """K φ = ω² M φ among displacements with W φ = 0, all of them, by dense matrices."""
    unit, n = unit_basis(body()), body().mesh.n_vertices
    kept = Basis.of(unit @ null_space(relaxation().rows @ unit), body().mass)
    squares, vectors = eigh(reduced_rest_stiffness(body(), kept), reduced_mass(body(), kept))
    return Modes((kept.matrix @ vectors).reshape(n, 3, -1), squares)


@cache
def condensed() -> Space:
    """u₀(z) = T₀ z and V_eff = ½ zᵀS₀z, as they are of a linear solid."""
    T, V = relaxation().rest.tangents.reshape(-1, R), relaxation().coordinates.matrix
    columns = orthonormal_rows(np.hstack([V, T - V]).T, body().mass).T
    basis = Basis.of(np.ascontiguousarray(columns), body().mass)
    skip = basis.project(T.T.reshape(R, -1, 3))
    decoder = Decoder.network([np.zeros((R, 2)), np.zeros((2, 2 * R))], [np.zeros(2), np.zeros(2 * R)], "elu", skip)
    points = np.arange(body().points.n_points)
    maps = np.zeros((len(points), 9, 2 * R))
    maps[:, :, :R] = strain_maps(body(), T, points)
    number = material_number("linear")
    rule = CubatureRule(points, body().points.weights, 0.0, maps, material=number)
    return Space.condensed(body(), basis, (decoder, Encoder((np.eye(2 * R, R),), (np.zeros(R),))), rule)


def pulled(size: float = SMALL) -> Loads:
    x = body().mesh.vertices
    tip, middle = np.argsort(-x[:, 0])[:4], np.argsort(np.abs(x[:, 0] - 0.6 * x[:, 0].max()))[:3]
    targets = [
        x[v].mean(axis=0) + size * np.array(way)
        for v, way in ((tip, (0.02, 0.05, -0.03)), (middle, (0.0, -0.03, 0.02)))
    ]
    return Loads((Grab(tip, targets[0], 40.0), Grab(middle, targets[1], 300.0)), size * np.array([1.0, -6.0, 2.0]))


def run(space: Space, loads: list[Loads], **options: object) -> list[Array]:
    stepper = ReducedStepper(space, ReducedOptions(tolerance=1e-16, max_iterations=500, **options))  # type: ignore[arg-type]
    state, found = stepper.rest(), []
    for each in loads:
        state, _ = stepper.step(state, each)
        found.append(stepper.displacement(state))
    return found


def test_the_slowest_modes_are_those_of_dense_matrices() -> None:
    found, every = slowest_modes(relaxation(), 6), every_mode()
    np.testing.assert_allclose(found.squares, every.squares[:6], rtol=1e-6)
    F = found.fields.reshape(-1, 6)
    np.testing.assert_allclose(F.T @ Basis.of(F, body().mass).dual, np.eye(6), atol=1e-8)
    assert np.abs(relaxation().rows @ F).max() < 1e-8
    assert not found.fields[body().pinned].any()
    # what the modes of dense matrices leave of them
    left = F - every.fields.reshape(-1, len(every.squares))[:, :6] @ (
        Basis.of(every.fields.reshape(-1, len(every.squares))[:, :6], body().mass).dual.T @ F
    )
    assert np.abs(left).max() < 1e-4 * np.abs(F).max()


def test_all_modes_together_give_way_as_the_residual_compliance() -> None:
    force = np.random.default_rng(1).normal(size=(2, *body().mesh.vertices.shape))
    C = relaxation().residual(force)
    np.testing.assert_allclose(every_mode().moved(force), C, atol=1e-9 * np.abs(C).max())


def test_a_mode_follows_as_far_as_it_is_stiff() -> None:
    squares, rate = np.array([1e-9, 4e4, 1e15]), 4e4
    follows, gives = following(squares, rate)
    np.testing.assert_allclose(follows, [0.0, 0.5, 1.0], atol=1e-9)
    np.testing.assert_allclose(gives, [1 / rate, 0.5 / rate, 0.0], atol=1e-14)


def test_with_all_modes_a_linear_solid_steps_exactly_as_full_space() -> None:
    loads = [pulled()] * 15 + [Loads()] * 15
    full = FullStepper(body(), FullOptions(tolerance=1e-18, max_iterations=500))
    state, expected = full.rest(), []
    for each in loads:
        state, _ = full.step(state, each)
        expected.append(state.u)
    size = np.abs(expected).max()
    found = run(swinging(condensed(), every_mode()), loads)
    np.testing.assert_allclose(found, expected, atol=1e-6 * size)
    some = Modes(every_mode().fields[:, :, :4].copy(), every_mode().squares[:4])
    off = [np.abs(np.array(run(space, loads)) - expected).max() for space in (condensed(), swinging(condensed(), some))]
    assert 1e-3 * size < off[1] < 0.7 * off[0]


@pytest.mark.parametrize("count", [1, 5, 40])
def test_where_the_solid_stands_still_modes_that_swing_change_nothing_however_far_it_bends(count: int) -> None:
    some = Modes(every_mode().fields[:, :, :count].copy(), every_mode().squares[:count], turns=True)
    loads = [pulled(1.0)] * 40  # a step takes the law of a dent as it is where it begins
    expected, found = (run(each, loads, quasistatic=True)[-1] for each in (condensed(), swinging(condensed(), some)))
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("count", [1, 9])
def test_a_space_decodes_to_the_same_poses_once_its_modes_swing(count: int) -> None:
    some = Modes(every_mode().fields[:, :, :count].copy(), every_mode().squares[:count])
    before, after, z = condensed(), swinging(condensed(), some), np.array([0.02, -0.01, 0.03])
    expected = before.displacement(before.decoder(z))
    np.testing.assert_allclose(after.displacement(after.decoder(z)), expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_array_equal(after.squares, some.squares)
    gram = after.reduced_basis.matrix.T @ after.reduced_basis.dual
    np.testing.assert_allclose(gram, np.eye(len(gram)), atol=1e-10)
