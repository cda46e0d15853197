"""The reduced potential and its tangents: against the full space at the decoded state."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.dynamics.full.potential import IncrementalPotential
from ldsim.dynamics.full.preconditioner import grab_rows
from ldsim.dynamics.reduced.potential import value_gradient
from ldsim.dynamics.reduced.tangent import add_spring_metric, current_tangent, rest_metric
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.space.decoder import Decoder
from tests.dynamics.reduced.solids import HEX, TET, curved, pull, stepper
from tests.helpers import derivative_order, smooth_basis

Array = NDArray[np.float64]


@pytest.mark.parametrize("body", [TET, HEX], ids=["tet4", "hex8"])
def test_the_potential_is_that_of_the_full_space_at_the_decoded_state(body: Scene) -> None:
    U, decoder = smooth_basis(body, 6), curved(6, 4)
    model, springs, work = stepper(body, U, decoder).compiled(pull(body))
    rng = np.random.default_rng(3)
    z, predictor = 0.02 * rng.normal(size=4), 0.02 * rng.normal(size=6)
    full = IncrementalPotential(body, (U @ predictor).reshape(-1, 3), pull(body).grabs)
    force = np.empty(len(U))
    expected = full.value_gradient(U @ decoder(z), force)
    gradient = np.empty(4)
    value = value_gradient(model, springs, predictor, z, work, gradient)
    assert value == pytest.approx(expected, rel=1e-10)
    np.testing.assert_allclose(gradient, decoder.vjp(z, U.T @ force), rtol=1e-9)


def test_the_gradient_is_the_derivative_of_the_potential() -> None:
    U, decoder = smooth_basis(TET, 6), curved(6, 4)
    model, springs, work = stepper(TET, U, decoder).compiled(pull(TET))
    rng = np.random.default_rng(4)
    z, d, predictor = 0.05 * rng.normal(size=4), 0.05 * rng.normal(size=4), np.zeros(6)
    gradient = np.empty(4)

    def value(x: Array) -> float:
        return value_gradient(model, springs, predictor, x, work, gradient)

    def slope(x: Array) -> float:
        value(x)
        return float(gradient @ d)

    assert derivative_order(value, slope, z, d) > 1.9


@pytest.mark.parametrize("decoder", [Decoder.identity(6), curved(6, 4)], ids=["linear", "latent"])
def test_the_preconditioners_are_the_full_spaces_stiffness_at_rest_and_now_seen_through_the_decoder(
    decoder: Decoder,
) -> None:
    U, some = smooth_basis(TET, 6), stepper(TET, smooth_basis(TET, 6), decoder)
    z = 0.3 * np.random.default_rng(5).normal(size=decoder.r)
    J, (model, springs, work) = decoder.jacobian(z), some.compiled(pull(TET))
    work.q[:], work.jacobian[:] = decoder(z), J.T
    u = (U @ work.q).reshape(-1, 3)
    pattern = StiffnessPattern(TET.points.nodes, np.arange(TET.mesh.n_vertices), TET.mesh.n_vertices)
    inertia = some.mass / TET.time_step**2
    for tangent, at in ((rest_metric, 0 * u), (current_tangent, u)):
        K = pattern.matrix(pattern.stiffness_blocks(TET.elements, at, clamp=True))
        expected = J.T @ (inertia + U.T @ (K @ U)) @ J
        tangent(model, work)
        np.testing.assert_allclose(work.hessian, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    before = work.hessian.copy()
    add_spring_metric(springs, model, work)
    rows = grab_rows(pull(TET).grabs, TET.mesh.n_vertices) @ U @ J
    np.testing.assert_allclose(work.hessian - before, rows.T @ rows, rtol=0, atol=1e-9 * np.abs(before).max())
