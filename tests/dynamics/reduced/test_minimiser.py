"""The minimisers: all find the same minimum, and what is exchanged in a preconditioner is what a new one would hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldsim.dynamics.reduced.minimiser import Exchange, exchange_springs
from ldsim.dynamics.reduced.potential import value_gradient
from ldsim.mechanics.loads import Loads
from ldsim.space.decoder import Decoder, decode, decode_jacobian
from tests.dynamics.reduced.solids import TET, curved, pull, run, stepper
from tests.helpers import smooth_basis

MINIMISERS: list[dict[str, object]] = [
    {"method": "lbfgs", "current": False},
    {"method": "lbfgs", "current": False, "inertia": False},
    {"method": "lbfgs"},
    {"method": "bfgs"},
    {"method": "bfgs", "current": False},
    {"method": "newton"},
    {"method": "lbfgs", "current": False, "inertia": False, "every_step": True, "extrapolate": False, "wolfe": True},
]


def test_springs_of_other_grabs_are_exchanged_in_the_preconditioner() -> None:
    some, rng = stepper(TET, smooth_basis(TET, 6), curved(6, 4)), np.random.default_rng(5)
    model, _, work = some.compiled()
    decode(model.layers, rng.normal(size=4), work.hidden, work.q)
    decode_jacobian(model.layers, work.hidden, work.tangents, work.jacobian)
    root, none = rng.normal(size=(4, 4)), np.zeros((0, 6))
    rest = root @ root.T + 4 * np.eye(4)
    released, held = rng.normal(size=(3, 6)), rng.normal(size=(6, 6))
    a, b = released @ work.jacobian.T, held @ work.jacobian.T
    H = np.linalg.inv(rest + a.T @ a)
    assert exchange_springs(model, Exchange(False, True, held, released), H, work)
    np.testing.assert_allclose(H, np.linalg.inv(rest + b.T @ b), rtol=1e-9)
    # nearly all curvature was the spring's: what is left is not known by the difference
    H = np.linalg.inv(rest + 1e6 * a.T @ a)
    assert not exchange_springs(model, Exchange(False, True, none, 1e3 * released), H, work)


@pytest.mark.parametrize("options", MINIMISERS, ids=str)
def test_another_basis_of_the_same_space_takes_the_same_steps(options: dict[str, object]) -> None:
    U = smooth_basis(TET, 6)
    mixed = U @ (np.eye(6) + 0.3 * np.random.default_rng(2).normal(size=(6, 6)))
    diagonal = stepper(TET, U, Decoder.identity(6), tolerance=1e-11, **options)
    dense = stepper(TET, mixed, Decoder.identity(6), tolerance=1e-11, **options)
    for a, b in zip(run(diagonal, pull(TET), 8), run(dense, pull(TET), 8), strict=True):
        np.testing.assert_allclose(dense.displacement(b), diagonal.displacement(a), atol=1e-8)


@pytest.mark.parametrize("options", MINIMISERS, ids=str)
@pytest.mark.parametrize("decoder", [Decoder.identity(6), curved(6, 4)], ids=["linear", "latent"])
def test_every_minimiser_takes_the_same_steps(decoder: Decoder, options: dict[str, object]) -> None:
    U = smooth_basis(TET, 6)
    reference = run(stepper(TET, U, decoder, tolerance=1e-10), pull(TET), 8)
    others = run(stepper(TET, U, decoder, tolerance=1e-10, **options), pull(TET), 8)
    for a, b in zip(reference, others, strict=True):
        np.testing.assert_allclose(b.q, a.q, atol=1e-8)


@pytest.mark.parametrize("decoder", [Decoder.identity(6), curved(6, 4)], ids=["linear", "latent"])
def test_where_the_minimiser_may_stop_it_goes_on_and_leaves_a_tenth_of_the_residual(decoder: Decoder) -> None:
    some, grab = stepper(TET, smooth_basis(TET, 6), decoder, tolerance=0.05), pull(TET).grabs[0]
    state, gradient = some.rest(), np.empty(decoder.r)
    for frame in range(40):
        before, loads = state, Loads((replace(grab, target=grab.target + [0, 0.05 * np.sin(0.2 * frame), 0]),))
        state, solution = some.step(before, loads)
        model, springs, work = some.compiled(loads)
        value_gradient(model, springs, 2 * before.q - before.q_previous, state.z, work, gradient)
        assert solution.gradient_norm <= 0.05
        assert np.linalg.norm(gradient) <= 0.1 * solution.gradient_norm
        np.testing.assert_allclose(state.q, decoder(state.z), rtol=1e-12, atol=1e-15)
