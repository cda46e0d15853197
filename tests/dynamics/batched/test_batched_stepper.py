"""Batched stepping: against the serial stepper, instance by instance, and its gradients against finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.batched import BatchedLoads, BatchedState, BatchedStepper
from ldsim.dynamics.batched.newton import newton_direction
from ldsim.dynamics.batched.stepper import FRAMES
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.errors import MotionError, SolverError
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.optimise.solution import Reason
from ldsim.space.decoder import Decoder
from ldsim.space.lifting import Lifting
from ldsim.space.space import Space
from tests.dynamics.batched.solids import K, R, basis, batched, body, curved, march, pulls, serial
from tests.dynamics.reduced.solids import placed, shaken
from tests.helpers import derivative_order, reduced_space, scene

Array = NDArray[np.float64]

DEVICES = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]


pytestmark = pytest.mark.usefixtures("steps")

DECODERS = {"linear": Decoder.identity(K), "elu": curved(), "tanh": curved("tanh"), "sigmoid": curved("sigmoid")}


# Every material in a latent space, every decoder with one material.
CASES = {f"{material} elu": (material, DECODERS["elu"]) for material in MATERIALS}
CASES |= {f"neo_hookean {name}": ("neo_hookean", decoder) for name, decoder in DECODERS.items()}


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(("material", "decoder"), CASES.values(), ids=CASES)
def test_fifty_frames_of_different_grabs_are_those_of_the_serial_stepper(
    material: str, decoder: Decoder, device: str
) -> None:
    several = [pulls(body(material), seed) for seed in range(3)]
    stepper = batched(body(material), decoder, tolerance=1e-9, device=device, piece=2)
    state = march(stepper, stepper.loads(several), 50)
    alone = serial(stepper.space)
    for i, some in enumerate(several):
        expected = alone.rest()
        for _ in range(50):
            expected, solution = alone.step(expected, some)
            assert solution.converged
        np.testing.assert_allclose(state.serial(i).q, expected.q, atol=1e-8)


def test_virtual_points_of_several_materials_are_those_of_the_serial_stepper() -> None:
    plain, rng = body(), np.random.default_rng(4)
    kinds = np.where(np.arange(plain.mesh.n_cells) % 2 == 0, MATERIALS["fixed_corotated"], plain.material)
    mixed = replace(plain, material=kinds.astype(np.int8))
    every = CubatureRule.every(mixed)
    maps = every.strain_maps(mixed, basis(plain))
    virtual = replace(every, maps=maps * rng.uniform(0.9, 1.1, maps.shape))
    pulled, space = pulls(plain, 1), reduced_space(mixed, basis(plain), curved(), virtual)
    stepper = BatchedStepper(space, tolerance=1e-9)
    state = march(stepper, stepper.loads([pulled]), 20)
    alone, on_mesh = serial(space), serial(space.with_rule(every))
    expected, other = alone.rest(), on_mesh.rest()
    for _ in range(20):
        expected, _ = alone.step(expected, pulled)
        other, _ = on_mesh.step(other, pulled)
    np.testing.assert_allclose(state.serial(0).q, expected.q, atol=1e-8)
    assert np.abs(other.q - expected.q).max() > 1e-5


def test_single_precision_follows_double_precision() -> None:
    several = [pulls(body(), seed) for seed in range(3)]
    fine, coarse = batched(body(), curved()), batched(body(), curved(), dtype=torch.float32, tolerance=1e-4)
    expected = march(fine, fine.loads(several), 20).q
    found = coarse.rest(3)
    for _ in range(20):
        found, _ = coarse.step(found, coarse.loads(several))
    assert found.q.dtype == torch.float32
    np.testing.assert_allclose(found.q, expected, atol=1e-3 * float(expected.abs().max()))


def test_a_softer_material_and_another_gravity_are_those_of_another_scene() -> None:
    plain = scene(beam(resolution=1), youngs_modulus=1.5e4, gravity=(0.0, 0.0, 4.0))
    other = replace(plain, load=body().load)
    reference, stepper = batched(other, curved()), batched(body(), curved())
    loads = stepper.loads([pulls(body(), 1)])
    changed = loads._replace(mu=loads.mu / 2, lam=loads.lam / 2, gravity=stepper.tensor([[0, 0, 4.0]]))
    expected = march(reference, reference.loads([pulls(body(), 1)]), 10)
    np.testing.assert_allclose(march(stepper, changed, 10).q, expected.q, atol=1e-8)


def test_a_dead_load_pulls_as_it_does_in_the_serial_stepper() -> None:
    loaded = replace(body(), load=np.tile([0.0, 0.5, 0.2], (body().mesh.n_vertices, 1)))
    stepper = batched(loaded, curved())
    alone = serial(stepper.space)
    expected = alone.rest()
    for _ in range(5):
        expected, _ = alone.step(expected, Loads())
    found = march(stepper, stepper.loads([Loads()]), 5)
    np.testing.assert_allclose(found.q[0], expected.q, atol=1e-8)
    unloaded = batched(body(), curved())
    assert not np.allclose(march(unloaded, unloaded.loads([Loads()]), 5).q[0], expected.q, atol=1e-4)


@pytest.mark.parametrize("piece", [None, 2], ids=["in one piece", "in pieces"])
def test_an_instance_moves_as_it_does_alone(piece: int | None) -> None:
    stepper = batched(body(), curved(), piece=piece)
    loads = stepper.loads([pulls(body(), seed) for seed in range(5)])
    together = march(stepper, loads, 10)
    for i in range(5):
        alone = march(stepper, loads.of(slice(i, i + 1)), 10)
        np.testing.assert_allclose(together.z[i], alone.z[0], rtol=0, atol=1e-9)


def test_a_lost_instance_is_reported_and_spoils_neither_the_others_nor_their_gradients() -> None:
    stepper = batched(body(), Decoder.identity(K))
    loads = stepper.loads([pulls(body(), seed) for seed in range(3)])
    healthy = march(stepper, loads, 3)
    inverted = 1e3 * torch.ones(K, dtype=torch.float64)
    states = [healthy.serial(0), ReducedState.moving(*[inverted.numpy()] * 4), healthy.serial(2)]
    factor = torch.ones((), dtype=torch.float64, requires_grad=True)
    state, solution = stepper.step(stepper.state(states), loads._replace(mu=loads.mu * factor))
    assert solution.lost.tolist() == [1]
    assert solution.reason.tolist() == [Reason.CONVERGED, Reason.INFINITE_START, Reason.CONVERGED]
    np.testing.assert_array_equal(state.q[1].detach(), inverted)
    state.q.sum().backward()
    alone = torch.ones((), dtype=torch.float64, requires_grad=True)
    kept = torch.tensor([0, 2])
    some, _ = stepper.step(healthy.of(kept), loads.of(kept)._replace(mu=loads.mu[kept] * alone))
    some.q.sum().backward()
    np.testing.assert_allclose(state.q[kept].detach(), some.q.detach(), atol=1e-9)
    assert float(factor.grad) == pytest.approx(float(alone.grad), rel=1e-6)


@pytest.mark.parametrize("material", MATERIALS)
def test_a_lost_instance_puts_nothing_that_is_no_number_into_a_gradient_that_is_shared(material: str) -> None:
    stepper, pulled = batched(body(material), curved()), pulls(body(material), 2)

    def after(loads: BatchedLoads) -> tuple[Tensor, list[int]]:
        """The slopes of all z by a stiffness and a factor in the moduli that all instances share, and who is lost."""
        n, shared = len(loads.mu), stepper.tensor([60.0, 1.0]).requires_grad_()
        common = {"stiffness": shared[0].expand(n, 1), "mu": shared[1].expand(n), "lam": shared[1].expand(n)}
        state, solution = stepper.step(stepper.rest(n), loads._replace(**common))
        return torch.autograd.grad(state.z.sum(), shared)[0], solution.lost.tolist()

    loads = stepper.loads([pulled, pulled])
    expected, _ = after(loads.of(slice(1)))
    found, lost = after(loads._replace(target=loads.target * stepper.tensor([1.0, torch.nan]).reshape(2, 1, 1)))
    assert lost == [1] and expected.all()
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_no_step_raises_the_potential_of_its_start() -> None:
    stepper = batched(body(), curved(), max_iterations=1)
    loads = stepper.loads([pulls(body(), seed) for seed in range(6)])
    state = stepper.rest(6)
    for _ in range(5):
        predictor, start = 2 * state.q - state.q_previous, 2 * state.z - state.z_previous
        before, _ = stepper.model.value_gradient(loads, predictor, start)
        state, solution = stepper.step(state, loads)
        assert (solution.value <= before).all()


def test_iterations_that_run_out_are_reported() -> None:
    stepper = batched(body(), curved(), max_iterations=1)
    _, solution = stepper.step(stepper.rest(1), stepper.loads([pulls(body(), 1)]))
    assert solution.reason.tolist() == [Reason.ITERATIONS_SPENT]
    assert solution.iterations.tolist() == [1]


def test_where_the_hessian_is_not_positive_the_direction_still_leads_down() -> None:
    H = torch.diag_embed(torch.tensor([[2.0, -1.0, 0.5], [1.0, 0.0, -3.0]], dtype=torch.float64))
    g = torch.tensor([[1.0, 2.0, -1.0], [1.0, 1.0, 1.0]], dtype=torch.float64)
    d = newton_direction(H, g)
    np.testing.assert_allclose(d[0], [-0.5, -2.0, 2.0])
    assert ((g * d).sum(1) < 0).all()


@pytest.mark.parametrize(("material", "decoder"), CASES.values(), ids=CASES)
def test_the_hessian_is_the_derivative_of_the_gradient(material: str, decoder: Decoder) -> None:
    stepper = batched(body(material), decoder)
    loads = stepper.loads([pulls(body(material), 1)])
    rng = np.random.default_rng(5)
    z, d, ahead = 0.02 * rng.normal(size=decoder.r), 0.02 * rng.normal(size=decoder.r), torch.zeros(1, K).double()

    def gradient(x: Array) -> Array:
        return stepper.model.value_gradient(loads, ahead, torch.tensor(x)[None])[1][0].numpy()

    def along(x: Array) -> Array:
        return stepper.model.hessian(loads, ahead, torch.tensor(x)[None])[0].numpy() @ d

    assert derivative_order(gradient, along, z, d) > 1.9


def _loss_of_three_steps(stepper: BatchedStepper, base: BatchedLoads, start: BatchedState) -> Callable[..., Tensor]:
    """A loss of the state after three steps as a function of all that a gradient may flow to."""

    def loss(q: Tensor, q_previous: Tensor, *values: Tensor) -> Tensor:
        names = ("target", "stiffness", "gravity", "mu", "lam")
        loads = base._replace(**dict(zip(names, values, strict=True)))
        state = replace(start, q=q, q_previous=q_previous)
        for _ in range(3):
            state, solution = stepper.step(state, loads)
            assert solution.converged.all()
        return (state.z**2).sum() + state.q.sum() + stepper.displacement(state, np.array([5])).sum()

    return loss


@pytest.mark.parametrize(("material", "decoder"), CASES.values(), ids=CASES)
def test_gradients_through_three_steps_are_finite_differences(material: str, decoder: Decoder) -> None:
    stepper = batched(body(material), decoder, tolerance=1e-12)
    base = stepper.loads([pulls(body(material), 1), pulls(body(material), 2)])
    start = march(batched(body(material), decoder), base, 2)
    inputs = (start.q, start.q_previous, base.target, base.stiffness, base.gravity, base.mu, base.lam)
    inputs = tuple(value.clone().requires_grad_() for value in inputs)
    loss = _loss_of_three_steps(stepper, base, start)
    assert torch.autograd.gradcheck(loss, inputs, eps=1e-5, atol=1e-5, rtol=1e-4, fast_mode=True)


@cache
def of_cells(cell_type: str) -> Scene:
    return scene(beam(resolution=1, cell_type=cell_type), youngs_modulus=3e4)


def movable(some: Scene, decoder: Decoder) -> Space:
    """A space that is prepared for pins that move."""
    lifting = Lifting.of(some, [shaken(some, 1, 0)])
    return reduced_space(some, basis(some), decoder, lifting=lifting)


def moved(some: Scene, frames: int, seed: int) -> list[Loads]:
    """A pull, a gravity that turns, and pins that move, frame by frame."""
    motion, pulled = shaken(some, frames, seed), pulls(some, seed)
    swing = [np.array([3.0 * np.sin(frame + seed), -9.81, 2.0]) for frame in range(frames)]
    return [pulled._replace(gravity=g, pins=placed(motion, frame)) for frame, g in enumerate(swing)]


@pytest.mark.parametrize("decoder", [Decoder.identity(K), curved()], ids=["linear", "latent"])
@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_pins_that_move_are_followed_as_by_the_serial_stepper(cell_type: str, decoder: Decoder) -> None:
    some = of_cells(cell_type)
    space, tips = movable(some, decoder), np.argsort(some.mesh.vertices[:, 0])[-4:]
    stepper, alone = BatchedStepper(space, tolerance=1e-9), serial(space)
    tracks = [moved(some, 12, 1), moved(some, 12, 2), [pulls(some, 3)] * 12]
    state, expected = stepper.rest(3), [alone.rest() for _ in tracks]
    for now in zip(*tracks, strict=True):
        state, solution = stepper.step(state, stepper.loads(now))
        assert solution.converged.all()
        expected = [alone.step(before, loads)[0] for before, loads in zip(expected, now, strict=True)]
        u = stepper.displacement(state, tips)
        for i, one in enumerate(expected):
            np.testing.assert_allclose(state.q[i], one.q, atol=1e-8)
            np.testing.assert_allclose(u[i], alone.displacement(one)[tips], atol=1e-8)
    assert float(state.a[:2].abs().amax()) > 0.01 and not state.a[2].any()
    # a batch that is taken apart and put together again goes on as it did
    again = stepper.state([state.serial(i) for i in range(3)])
    now = stepper.loads([track[-1] for track in tracks])
    np.testing.assert_allclose(stepper.step(again, now)[0].q, stepper.step(state, now)[0].q, atol=1e-9)


@pytest.mark.parametrize("decoder", [Decoder.identity(K), curved()], ids=["linear", "latent"])
def test_gradients_flow_where_pins_move(decoder: Decoder) -> None:
    some = of_cells("tet4")
    stepper = BatchedStepper(movable(some, decoder), tolerance=1e-12)
    frames = [stepper.loads(now) for now in zip(moved(some, 3, 1), moved(some, 3, 2), strict=True)]
    start, _ = stepper.step(stepper.rest(2), frames[0])
    first = frames[1]
    inputs = (start.q, start.a, first.a, first.target, first.gravity, first.mu, first.lam)
    inputs = tuple(value.clone().requires_grad_() for value in inputs)

    def loss(q: Tensor, before: Tensor, a: Tensor, *values: Tensor) -> Tensor:
        state = replace(start, q=q, a=before)
        shared = dict(zip(("gravity", "mu", "lam"), values[1:], strict=True))
        for loads in (first._replace(a=a, target=values[0]), frames[2]):
            state, solution = stepper.step(state, loads._replace(**shared))
            assert solution.converged.all()
        return (state.z**2).sum() + state.q.sum() + stepper.displacement(state, np.array([5])).sum()

    assert torch.autograd.gradcheck(loss, inputs, eps=1e-5, atol=1e-5, rtol=1e-4)


def test_pins_that_the_space_was_not_prepared_for_are_refused() -> None:
    pins = MovedPins(np.flatnonzero(body().pinned), np.eye(3, 4))
    with pytest.raises(MotionError, match="pins move, the first at vertex .*; this space was not prepared for them"):
        batched(body(), curved()).loads([Loads(pins=(pins,))])


def test_every_single_derivative_of_a_step_is_a_finite_difference() -> None:
    stepper = batched(body(), curved(), tolerance=1e-12)
    base = stepper.loads([pulls(body(), 1)])
    start = march(stepper, base, 2)
    inputs = (start.q, base.target, base.stiffness, base.gravity, base.mu, base.lam)
    inputs = tuple(value.clone().requires_grad_() for value in inputs)

    def after(q: Tensor, *values: Tensor) -> Tensor:
        loads = base._replace(**dict(zip(("target", "stiffness", "gravity", "mu", "lam"), values, strict=True)))
        return stepper.step(replace(start, q=q), loads)[0].q

    assert torch.autograd.gradcheck(after, inputs, eps=1e-5, atol=1e-6, rtol=1e-4)


def test_a_state_comes_back_from_the_batch_as_it_went_in() -> None:
    stepper = batched(body(), curved())
    state = march(stepper, stepper.loads([pulls(body(), 1), pulls(body(), 2)]), 3)
    again = stepper.state([state.serial(i) for i in range(2)])
    for name in FRAMES:
        np.testing.assert_array_equal(getattr(again, name), getattr(state, name))
    assert not again.kept.any()


@pytest.mark.parametrize("wrong", [{}, {"mu": 1}, {"target": 1}])
def test_loads_of_another_number_of_instances_are_refused(wrong: dict[str, int]) -> None:
    stepper = batched(body(), curved())
    loads = stepper.loads([pulls(body(), 1)] * (3 if wrong else 1))
    loads = loads._replace(**{name: getattr(loads, name)[:count] for name, count in wrong.items()})
    with pytest.raises(SolverError, match="loads of 1 instances, a state of 3"):
        stepper.step(stepper.rest(3), loads)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"dtype": torch.float16}, "float32"), ({"device": "cuda:99"}, "use 'cpu'")][: 2 - torch.cuda.is_available()],
)
def test_a_type_or_device_that_is_not_there_is_named(options: dict[str, object], words: str) -> None:
    with pytest.raises(SolverError, match=words):
        batched(body(), curved(), **options)


def test_a_full_space_and_a_state_of_another_model_are_refused() -> None:
    with pytest.raises(SolverError, match="batched stepping in the full space; it needs a reduced one"):
        BatchedStepper(Space.full(body()))
    other = serial(reduced_space(body(), basis(body())[:, :2])).rest()
    with pytest.raises(ValueError, match=rf"a state has \(r, k\) = \(2, 2\); this stepper has \({R}, {K}\)"):
        batched(body(), curved()).state([other])


def test_a_batched_state_of_another_model_is_not_stepped() -> None:
    stepper, pulled = batched(body(), curved()), [pulls(body(), 1)] * 2
    for columns in (R, K):  # one number is that of the stepper, the other is not
        state = BatchedStepper(reduced_space(body(), basis(body())[:, :columns])).rest(2)
        words = rf"the state has \(r, k\) = \({columns}, {columns}\); this stepper has \({R}, {K}\)"
        with pytest.raises(ValueError, match=words):
            stepper.step(state, stepper.loads(pulled))


@pytest.mark.parametrize("numbers", [torch.Tensor.clone, torch.Tensor.tolist, torch.Tensor.numpy])
def test_one_gravity_is_that_of_every_instance(numbers: Callable[[Tensor], Any]) -> None:
    stepper, g = batched(body(), curved()), torch.tensor([1.0, 2.0, -9.0], dtype=torch.float64)
    for count in (2, 3):
        loads = stepper.loads([pulls(body(), 1)] * count)
        one = march(stepper, loads._replace(gravity=numbers(g)), 2)
        each = march(stepper, loads._replace(gravity=numbers(g.repeat(count, 1))), 2)
        np.testing.assert_array_equal(one.q, each.q)


@pytest.mark.parametrize("gravity", [[1.0, 2.0], -9.8, [[0.0, -9.8]] * 2])
def test_a_gravity_of_another_shape_is_refused(gravity: Any) -> None:
    stepper = batched(body(), curved())
    loads = stepper.loads([pulls(body(), 1)] * 2)._replace(gravity=gravity)
    with pytest.raises(SolverError, match=r"gravity has the shape \(.*\); it must be \(3,\) or \(2, 3\), m/s²"):
        stepper.step(stepper.rest(2), loads)
