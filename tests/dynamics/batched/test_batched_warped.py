"""Batches of a condensed space: against the serial stepper, and gradients through its grabs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from torch import Tensor

from ldsim.arrays import Indices
from ldsim.dynamics.batched import BatchedLoads, BatchedState, BatchedStepper
from ldsim.dynamics.batched.warped import warps
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.errors import SolverError
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.space.compliance import LEAST_STRETCH, MOST_CHANGED, warp
from ldsim.space.space import Space
from tests.dynamics.batched.solids import march
from tests.runtime.problems import condensed, with_linear_dents

pytestmark = pytest.mark.usefixtures("steps")

DEVICES = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
SPACES = {
    "bent dents": condensed,
    "linear dents": lambda: with_linear_dents("neo_hookean"),
    "modes that swing": lambda: condensed(modes=4, turns=False),
    "modes that turn": lambda: condensed(modes=4),
}


@cache
def space(kind: str) -> Space:
    return SPACES[kind]()


def tip(some: Space) -> Indices:
    return np.argsort(-some.scene.mesh.vertices[:, 0])[:4]


def drawn(some: Space) -> Indices:
    return np.flatnonzero(~some.scene.pinned)[-9:]


def held(some: Space, vertices: Indices, way: tuple[float, float, float], stiffness: float) -> Grab:
    return Grab(vertices, some.scene.mesh.vertices[vertices].mean(axis=0) + way, stiffness)


def acting(some: Space) -> list[Loads]:
    """A pull, two, none under another gravity, and one under a third so hard that the laws of dents end."""
    end, other = tip(some), np.arange(30, 34)
    hard = held(some, other, (0.09, 0.15, 0.06), 5000.0)
    return [
        Loads((held(some, end, (0.05, 0.06, -0.03), 30.0),)),
        Loads((held(some, end, (0.02, -0.06, 0.03), 80.0), held(some, other, (0.0, 0.02, 0.02), 50.0))),
        Loads((), np.array([0.0, 4.0, -2.0])),
        Loads((hard,), np.array([3.0, 0.0, -9.0])),
    ]


def serial(some: Space) -> ReducedStepper:
    return ReducedStepper(some, ReducedOptions(tolerance=1e-10, max_iterations=500))


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("kind", SPACES)
def test_frames_of_different_grabs_and_their_dents_are_those_of_the_serial_stepper(kind: str, device: str) -> None:
    loads, alone = acting(space(kind)), serial(space(kind))
    stepper = BatchedStepper(space(kind), tolerance=1e-10, device=device, piece=3)
    state = march(stepper, stepper.loads(loads), 12)
    u = stepper.displacement(state, np.arange(space(kind).scene.mesh.n_vertices)).cpu().numpy()
    for i, own in enumerate(loads):
        expected = alone.rest()
        for _ in range(12):
            expected, _ = alone.step(expected, own)
        np.testing.assert_allclose(state.serial(i).q, expected.q, atol=1e-11)
        np.testing.assert_allclose(u[i], alone.displacement(expected), atol=1e-11)
        np.testing.assert_allclose(alone.displacement(state.serial(i)), u[i], atol=1e-11)
        again = stepper.displacement(stepper.state([expected]), drawn(space(kind))).cpu()
        np.testing.assert_allclose(again[0], u[i, drawn(space(kind))], atol=1e-11)
    some = stepper.displacement(state.of(torch.tensor([3, 0], device=device)), drawn(space(kind))).cpu()
    np.testing.assert_allclose(some, u[[3, 0]][:, drawn(space(kind))], atol=1e-14)


@pytest.mark.parametrize("kind", SPACES)
def test_at_rest_it_is_where_its_weight_has_it(kind: str) -> None:
    stepper, alone = BatchedStepper(space(kind)), serial(space(kind))
    vertices = drawn(space(kind))
    u = stepper.displacement(stepper.rest(2), vertices)
    np.testing.assert_allclose(u, np.stack([alone.displacement(alone.rest())[vertices]] * 2), atol=1e-15)
    assert float(u.abs().max()) > 0


@pytest.mark.parametrize("kind", SPACES)
def test_a_softer_solid_is_that_of_the_stiffened_stepper(kind: str) -> None:
    own, stepper = acting(space(kind))[0], BatchedStepper(space(kind), tolerance=1e-10)
    loads = stepper.loads([own])
    state = march(stepper, loads._replace(mu=0.7 * loads.mu, lam=0.7 * loads.lam), 8)
    softer = serial(space(kind)).stiffened(0.7)
    expected = softer.rest()
    for _ in range(8):
        expected, _ = softer.step(expected, own)
    np.testing.assert_allclose(state.q[0], expected.q, atol=1e-11)
    vertices = drawn(space(kind))
    u = stepper.displacement(state, vertices)[0]
    np.testing.assert_allclose(u, softer.displacement(expected)[vertices], atol=1e-11)


def test_a_grab_of_no_stiffness_is_none() -> None:
    some = space("bent dents")
    pulls, stepper = acting(some)[1], BatchedStepper(some, tolerance=1e-10)
    two, one = stepper.loads([pulls]), stepper.loads([Loads(pulls.grabs[:1])])
    let_go = two._replace(stiffness=two.stiffness * stepper.tensor([[1.0, 0.0]]))
    found, expected = march(stepper, let_go, 8), march(stepper, one, 8)
    np.testing.assert_allclose(found.q, expected.q, atol=1e-11)
    vertices = drawn(some)
    np.testing.assert_allclose(
        stepper.displacement(found, vertices), stepper.displacement(expected, vertices), atol=1e-11
    )


@pytest.mark.parametrize("kind", SPACES)
def test_gradients_through_three_steps_are_finite_differences(kind: str) -> None:
    some = space(kind)
    stepper = BatchedStepper(some, tolerance=1e-12)
    base = stepper.loads(acting(some)[1:])
    start = march(BatchedStepper(some), base, 2)

    def loss(q: Tensor, q_previous: Tensor, target: Tensor, stiffness: Tensor, gravity: Tensor, mu: Tensor) -> Tensor:
        loads = base._replace(target=target, stiffness=stiffness, gravity=gravity, mu=mu, lam=mu)
        state = replace(start, q=q, q_previous=q_previous)
        for _ in range(3):
            state, solution = stepper.step(state, loads)
            assert solution.converged.all()
        return (state.z**2).sum() + state.q.sum() + stepper.displacement(state, np.array([5, *tip(some)])).sum()

    inputs = (start.q, start.q_previous, base.target, base.stiffness, base.gravity, base.mu)
    inputs = tuple(value.clone().requires_grad_() for value in inputs)
    # a stiffness of zero has no slope
    inputs = (*inputs[:3], (base.stiffness + (base.stiffness == 0)).requires_grad_(), *inputs[4:])
    assert torch.autograd.gradcheck(loss, inputs, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True)


def some_gradient(stretches: tuple[float, float, float]) -> Tensor:
    P, Q = np.linalg.qr(np.random.default_rng(3).normal(size=(2, 3, 3)))[0]
    P, Q = P * np.sign(np.linalg.det(P)), Q * np.sign(np.linalg.det(Q))
    return torch.tensor(P @ np.diag(stretches) @ Q)[None]


@pytest.mark.parametrize(
    "stretches", [(1.3, 1.1, 0.8), (1.2, 1.2, 0.9), (1.0, 1.0, 1.0), (1.4, 0.9, LEAST_STRETCH / 2), (1.2, 0.9, -0.1)]
)
def test_a_warp_is_that_of_the_serial_one_and_its_slope_that_of_differences(
    stretches: tuple[float, float, float],
) -> None:
    F = some_gradient(stretches)
    if min(stretches) > 0:
        np.testing.assert_allclose(warps(F)[0][0], warp(F[0].numpy()), atol=1e-12)
        np.testing.assert_allclose(torch.linalg.det(warps(F)[1]), 1.0, atol=1e-12)
    function: Callable[[Tensor], tuple[Tensor, ...]] = warps
    assert torch.autograd.gradcheck(function, (F.requires_grad_(),), eps=1e-6, atol=1e-6)


def test_single_precision_follows_double_precision() -> None:
    some = space("bent dents")
    fine, coarse = BatchedStepper(some), BatchedStepper(some, dtype=torch.float32, tolerance=1e-4)
    expected, found = march(fine, fine.loads(acting(some)), 8), coarse.rest(4)
    for _ in range(8):
        found, _ = coarse.step(found, coarse.loads(acting(some)))
    np.testing.assert_allclose(found.q, expected.q, atol=1e-3 * float(expected.q.abs().max()))


def test_other_factors_in_one_modulus_than_in_the_other_are_refused() -> None:
    stepper = BatchedStepper(space("bent dents"))
    loads = stepper.loads([Loads()])
    with pytest.raises(SolverError, match="one factor for both moduli"):
        stepper.step(stepper.rest(1), loads._replace(mu=2 * loads.mu))


def test_the_loads_of_the_gradient_test_reach_where_the_laws_of_dents_end() -> None:
    some = space("bent dents")
    stepper = BatchedStepper(some)
    loads = stepper.loads(acting(some))
    found = loads.in_series(march(stepper, loads, 2).q)
    bent = torch.einsum("ngijk,ngk->ngij", found.second, found.force)
    size = (found.root @ bent @ found.root).square().sum((-2, -1)).sqrt()
    assert (size > MOST_CHANGED).any() and (size < MOST_CHANGED).any()


@pytest.mark.parametrize("spoilt", ["target", "stiffness", "gravity", "q"])
@pytest.mark.parametrize("of", ["bent dents", "modes that turn"])
def test_an_instance_that_is_not_finite_is_lost_and_the_others_do_not_notice(spoilt: str, of: str) -> None:
    some, vertices = space(of), drawn(space(of))
    stepper = BatchedStepper(some)
    loads = stepper.loads(acting(some)[:2])
    start = march(stepper, loads, 3)

    def after(loads: BatchedLoads, state: BatchedState) -> tuple[BatchedState, Tensor, Tensor]:
        factor = torch.ones((), dtype=torch.float64, requires_grad=True)
        new, solution = stepper.step(state, loads._replace(mu=factor.expand(2), lam=factor.expand(2)))
        u = stepper.displacement(new, vertices)
        (slope,) = torch.autograd.grad(u[0].sum() + new.q[0].sum(), factor)
        return new, slope, solution.lost

    fine, expected, _ = after(loads, start)
    row = torch.tensor([[0.0], [torch.inf if spoilt == "target" else torch.nan]], dtype=torch.float64)
    if spoilt == "q":
        found, slope, lost = after(loads, replace(start, q=start.q + row))
    else:
        value = getattr(loads, spoilt)
        found, slope, lost = after(loads._replace(**{spoilt: value + row.reshape(2, *[1] * (value.dim() - 1))}), start)
    assert lost.tolist() == [1]
    torch.testing.assert_close(found.q[0], fine.q[0])
    torch.testing.assert_close(slope, expected)
    assert torch.isfinite(stepper.displacement(found, vertices)[1]).all() == (spoilt != "q")


def test_no_gradient_flows_through_a_state_that_is_detached() -> None:
    some = space("bent dents")
    stepper = BatchedStepper(some)
    loads = stepper.loads(acting(some)[:1])
    target = loads.target.clone().requires_grad_()
    state, _ = stepper.step(stepper.rest(1), loads._replace(target=target))
    assert stepper.displacement(state, drawn(some)).requires_grad
    assert not stepper.displacement(state.detached(), drawn(some)).requires_grad


def test_a_batch_of_none_is_stepped() -> None:
    stepper = BatchedStepper(space("bent dents"))
    state, solution = stepper.step(stepper.rest(0), stepper.loads([]))
    assert state.q.shape == (0, stepper.model.decoder.k) and len(solution.lost) == 0


@pytest.mark.parametrize("kind", SPACES)
def test_one_gravity_is_that_of_every_instance(kind: str) -> None:
    stepper, g = BatchedStepper(space(kind)), torch.tensor([3.0, 4.0, -2.0], dtype=torch.float64)
    loads, vertices = stepper.loads(acting(space(kind))[:2]), drawn(space(kind))
    states = [march(stepper, loads._replace(gravity=given), 2) for given in (g, g.repeat(2, 1))]
    one, each = (stepper.displacement(state, vertices) for state in states)
    np.testing.assert_array_equal(one, each)
