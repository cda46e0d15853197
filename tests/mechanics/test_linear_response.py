"""Linear elasticity at rest against the theory of beams and columns, and how it scales."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ldsim.dynamics.full.linear_choice import choose
from ldsim.mechanics.linear_response import LinearResponse
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import beam
from ldsim.optimise.sparse import Factor
from tests.helpers import scene as scene_of

LENGTH, THICKNESS, MODULUS, DENSITY, G = 0.4, 0.04, 1e6, 1000.0, 9.81
AREA, INERTIA = THICKNESS**2, THICKNESS**4 / 12


def cantilever(resolution: int, gravity: tuple[float, float, float] = (0.0, -G, 0.0), size: float = 1.0) -> Scene:
    mesh = beam(LENGTH, THICKNESS, THICKNESS, resolution, cell_type="hex8")
    mesh = Mesh(size * mesh.vertices, mesh.cells, mesh.cell_type)
    return scene_of(mesh, "stable_neo_hookean", MODULUS, 0.3, gravity=gravity, density=DENSITY)


def response(scene: Scene) -> LinearResponse:
    choice = choose(scene, "direct")
    assert choice.elimination is not None
    return LinearResponse(scene, choice.order, choice.elimination)


def tip(scene: Scene) -> np.ndarray:
    return np.flatnonzero(scene.mesh.vertices[:, 0] > LENGTH - 1e-9)


def converged(coarse: float, fine: float) -> float:
    """Richardson's extrapolation of an error of second order."""
    return (4 * fine - coarse) / 3


def test_a_cantilever_bends_stretches_and_swings_as_beam_theory_says() -> None:
    bends, swings, sags = [], [], []
    for resolution in (2, 4):
        scene = cantilever(resolution)
        made, end = response(scene), tip(scene)
        compliance = made.of_grip(end)[end].mean(axis=0)
        np.testing.assert_allclose(compliance[0, 0], LENGTH / (MODULUS * AREA), rtol=0.02)
        np.testing.assert_allclose(compliance, compliance.T, atol=1e-9)
        bends.append(compliance[1, 1])
        swings.append(made.frequencies(2)[0])
        sags.append(-made.displacement(scene.external_force)[end, 1].mean())
    weight = DENSITY * AREA * G
    first = 1.8751**2 / (2 * math.pi) * math.sqrt(MODULUS * INERTIA / (DENSITY * AREA * LENGTH**4))
    assert converged(*bends) == pytest.approx(LENGTH**3 / (3 * MODULUS * INERTIA), rel=0.02)
    assert converged(*swings) == pytest.approx(first, rel=0.02)
    assert converged(*sags) == pytest.approx(weight * LENGTH**4 / (8 * MODULUS * INERTIA), rel=0.02)


def test_a_column_buckles_under_its_weight_where_greenhill_says() -> None:
    """Greenhill 1881: ρ g A L³ = 7.837 E I, for a column on a clamped foot."""
    found = [response(scene := cantilever(n, (-G, 0.0, 0.0))).load_factor(scene.external_force) for n in (2, 4)]
    expected = 7.837 * MODULUS * INERTIA / (DENSITY * G * AREA * LENGTH**3)
    assert converged(*found) == pytest.approx(expected, rel=0.02)


def test_what_is_only_stretched_or_only_bent_does_not_buckle() -> None:
    hanging, standing = cantilever(2, (G, 0.0, 0.0)), cantilever(2)
    column = response(cantilever(2, (-G, 0.0, 0.0))).load_factor(cantilever(2, (-G, 0.0, 0.0)).external_force)
    assert response(hanging).load_factor(hanging.external_force) > 20 * column
    assert response(standing).load_factor(standing.external_force) > column
    assert response(standing).load_factor(np.zeros_like(standing.mesh.vertices)) == math.inf


def test_that_a_hanging_solid_does_not_buckle_is_found_in_few_solves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its load factors are far beyond 1 and close together, so that Lanczos would search for them for ever."""
    hanging, solve, solves = cantilever(1, (G, 0.0, 0.0)), Factor.solve, list[int]()

    def counted(factor: Factor, right: np.ndarray) -> np.ndarray:
        solves.append(len(right))
        return solve(factor, right)

    monkeypatch.setattr(Factor, "solve", counted)
    assert response(hanging).load_factor(hanging.external_force) >= 1
    assert len(solves) < 800


def test_strain_is_that_of_a_stretched_bar_and_none_of_a_turned_one() -> None:
    scene = cantilever(2)
    made, x = response(scene), scene.mesh.vertices
    np.testing.assert_allclose(made.strain(0.01 * x * [1, 0, 0]), 0.01, rtol=1e-9)
    np.testing.assert_allclose(made.strain(np.cross([0.0, 0.0, 0.1], x)), 0, atol=1e-12)


def test_a_solid_twice_the_size_is_half_as_compliant_and_half_as_fast() -> None:
    small, large = cantilever(2), cantilever(2, size=2.0)
    one, two = response(small), response(large)
    end = tip(small)
    np.testing.assert_allclose(two.of_grip(end), 0.5 * one.of_grip(end), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(two.frequencies(4), 0.5 * one.frequencies(4), rtol=1e-3)
    np.testing.assert_allclose(
        two.load_factor(large.external_force), 0.5 * one.load_factor(small.external_force), rtol=1e-3
    )
