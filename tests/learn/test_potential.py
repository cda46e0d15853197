"""The network of a condensed space: what a fit compares are derivatives of one energy and of one pose."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ldsim.arrays import Array
from ldsim.learn.network import ACTIVATIONS as TORCH
from ldsim.learn.options import CondensedOptions, TrainOptions
from ldsim.learn.potential import Derivatives, PotentialNetwork
from ldsim.learn.stress import MATERIAL, stresses, stresses_adjoint
from ldsim.mechanics.materials import material_number
from ldsim.mechanics.materials.kernels import energy, energy_stress
from ldsim.space.activation import ACTIVATIONS

R, K, POINTS, B = 3, 4, 2, 5
RATIO = np.array([1.5, 7.0])


def normal(seed: int, *shape: int) -> Array:
    return np.random.default_rng(seed).normal(size=shape)


@pytest.fixture(params=sorted(ACTIVATIONS))
def network(request: pytest.FixtureRequest) -> PotentialNetwork:
    options = TrainOptions(kind="condensed", hidden=(6, 5), activation=request.param)
    options = options.replace(condensed=CondensedOptions(points=POINTS, features=2, columns=K))
    with torch.random.fork_rng():
        torch.manual_seed(4)
        found = PotentialNetwork.drawn(RATIO, np.array([1.0, 0.5, 0.2, 0.1]), normal(3, R, K), options)
    # far from where it starts, so that no term is small
    for i, parameter in enumerate(found.parameters):
        parameter += 0.3 * normal(i, *parameter.shape)
    return found


def rows(seed: int) -> Array:
    return normal(seed, B, R)


def found_at(network: PotentialNetwork, y: Array, v: Array, w: Array) -> Derivatives:
    return network.derivatives(y, v, w, network.strains())[0]


def slaved_and_energy(network: PotentialNetwork, y: Array) -> tuple[Array, Array]:
    """As the module says them, without any derivative: with what at rest is exact taken off by the network's own."""
    twin = torch.nn.Sequential()
    for i, (W, b) in enumerate(zip(network.weights, network.biases, strict=True)):
        linear = torch.nn.Linear(*W.shape).double()
        linear.weight.data, linear.bias.data = torch.tensor(W.T), torch.tensor(b)
        twin.append(linear)
        if i < len(network.weights) - 1:
            twin.append(TORCH[network.activation]())
    at_rest = torch.autograd.functional.jacobian(twin, torch.zeros(R, dtype=torch.float64)).numpy()
    at_y, at_zero = (twin(torch.tensor(x)).detach().numpy() for x in (y, 0 * y))
    out = at_y - at_zero - y @ at_rest.T
    f, slaved = out[:, :2], out[:, 2:] * network.spread + y @ network.tangents
    strain = (np.hstack([y, f]) @ network.strains().maps.T).reshape(len(y), POINTS, 9)
    kind, weights = material_number(MATERIAL), np.exp(network.logarithms)
    values = [
        sum(
            w * energy(kind, tuple((np.eye(3).ravel() + s).tolist()), 1.0, ratio)
            for w, s, ratio in zip(weights, row, RATIO, strict=True)
        )
        for row in strain
    ]
    return slaved, np.array(values)


def test_the_force_is_the_slope_of_the_energy(network: PotentialNetwork) -> None:
    y, v, h = 0.5 * rows(0), rows(1), 1e-6
    force = found_at(network, y, v, v).force
    change = slaved_and_energy(network, y + h * v)[1] - slaved_and_energy(network, y - h * v)[1]
    np.testing.assert_allclose((force * v).sum(axis=1), change / (2 * h), rtol=1e-6, atol=1e-7)


def test_what_changes_is_what_differences_say(network: PotentialNetwork) -> None:
    y, v, w, h = 0.5 * rows(0), rows(1), rows(2), 1e-6
    _, image, slaved, along = found_at(network, y, v, w)
    forwards, backwards = (found_at(network, y + s * h * v, v, w).force for s in (1, -1))
    np.testing.assert_allclose(image, (forwards - backwards) / (2 * h), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(slaved, slaved_and_energy(network, y)[0], rtol=1e-12, atol=1e-12)
    forwards, backwards = (slaved_and_energy(network, y + s * h * w)[0] for s in (1, -1))
    np.testing.assert_allclose(along, (forwards - backwards) / (2 * h), rtol=1e-6, atol=1e-6)


def test_the_gradient_of_a_loss_is_right_for_every_parameter(network: PotentialNetwork) -> None:
    y, v, w = 0.5 * rows(0), rows(1), rows(2)
    weights = Derivatives(*(normal(5 + i, B, n) for i, n in enumerate((R, R, K, K))))

    def loss() -> float:
        found = found_at(network, y, v, w)
        return sum(float((weight * each).sum()) for weight, each in zip(weights, found, strict=True))

    gradient = network.gradient(network.derivatives(y, v, w, network.strains())[1], weights)
    h = 1e-6
    for i, (parameter, slope) in enumerate(zip(network.parameters, gradient, strict=True)):
        direction = normal(20 + i, *parameter.shape)
        parameter += h * direction
        above = loss()
        parameter -= 2 * h * direction
        change = (above - loss()) / (2 * h)
        parameter += h * direction
        assert float((slope * direction).sum()) == pytest.approx(change, rel=1e-5, abs=1e-6)


def strains(seed: int = 0) -> Array:
    """So large that some points are inverted; and their changes."""
    return 0.6 * normal(seed, 2 * B, 9 * POINTS)


def test_the_stress_is_that_of_the_compiled_material() -> None:
    found, expected = stresses(strains(), RATIO)[:B], np.empty((B, 9 * POINTS))
    for i, row in enumerate(strains()[:B].reshape(B, POINTS, 9)):
        for s, (strain, ratio) in enumerate(zip(row, RATIO, strict=True)):
            F = np.eye(3).ravel() + strain
            expected[i, 9 * s : 9 * s + 9] = energy_stress(material_number(MATERIAL), tuple(F.tolist()), 1.0, ratio)[1]
    F = np.eye(3).ravel() + strains()[:B].reshape(B, POINTS, 9)
    assert np.linalg.det(F.reshape(-1, 3, 3)).min() < -0.1  # one is inverted
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_the_change_of_the_stress_and_the_way_back_are_those_of_differences() -> None:
    at, h = strains(), 1e-6
    forwards, backwards = (stresses(np.concatenate([at[:B] + s * h * at[B:], at[B:]]), RATIO)[:B] for s in (1, -1))
    np.testing.assert_allclose(stresses(at, RATIO)[B:], (forwards - backwards) / (2 * h), rtol=1e-6, atol=1e-7)
    weights, direction = strains(1), strains(2)
    forwards, backwards = (stresses(at + s * h * direction, RATIO) for s in (1, -1))
    expected = (weights * (forwards - backwards)).sum() / (2 * h)
    assert (stresses_adjoint(at, RATIO, weights) * direction).sum() == pytest.approx(expected, rel=1e-6)
