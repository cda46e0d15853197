"""The network of a condensed space: what a fit compares are derivatives of one energy and of one pose."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ldsim.learn.options import CondensedOptions, TrainOptions
from ldsim.learn.potential import DERIVATIVES, PotentialNetwork
from ldsim.learn.stress import MATERIAL, stresses
from ldsim.mechanics.materials import material_number
from ldsim.mechanics.materials.kernels import energy, energy_stress

R, K, POINTS, B = 3, 4, 2, 5
RATIO = torch.tensor([1.5, 7.0], dtype=torch.float64)


def strains(seed: int = 0) -> torch.Tensor:
    """So large that some points are inverted; and their changes."""
    return 0.6 * torch.randn(2 * B, 9 * POINTS, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@pytest.fixture(params=sorted(DERIVATIVES))
def network(request: pytest.FixtureRequest) -> PotentialNetwork:
    generator = torch.Generator().manual_seed(3)
    options = TrainOptions(kind="condensed", hidden=(6, 5), activation=request.param)
    options = options.replace(condensed=CondensedOptions(points=POINTS, features=2, columns=K))
    tangents = torch.randn(R, K, generator=generator, dtype=torch.float64)
    with torch.random.fork_rng():
        torch.manual_seed(4)
        found = PotentialNetwork(RATIO, torch.tensor([1.0, 0.5, 0.2, 0.1]), tangents, options).double()
    # far from where it starts, so that no term is small
    for parameter in found.parameters():
        parameter.data += 0.3 * torch.randn(parameter.shape, generator=generator, dtype=torch.float64)
    return found


def rows(seed: int) -> torch.Tensor:
    return torch.randn(B, R, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def slaved_and_energy(network: PotentialNetwork, y: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """As the module says them, without any derivative: with what at rest is exact taken off by the network's own."""
    at_rest = torch.autograd.functional.jacobian(network.network, torch.zeros(R, dtype=torch.float64))
    out = network.network(y) - network.network(0 * y) - y @ at_rest.T
    f, slaved = out[:, :2], out[:, 2:] * network.spread + y @ network.tangents
    strain = (torch.cat([y, f], dim=1) @ network.strain_maps().T).view(len(y), POINTS, 9).detach().numpy()
    kind, weights = material_number(MATERIAL), network.logarithms.exp().tolist()
    values = [
        sum(
            w * energy(kind, tuple((np.eye(3).ravel() + s).tolist()), 1.0, ratio)
            for w, s, ratio in zip(weights, row, RATIO.tolist(), strict=True)
        )
        for row in strain
    ]
    return slaved, torch.tensor(values, dtype=torch.float64)


def test_the_force_is_the_slope_of_the_energy(network: PotentialNetwork) -> None:
    y, v, h = 0.5 * rows(0), rows(1), 1e-6
    force, *_ = network.derivatives(y, v, v)
    change = slaved_and_energy(network, y + h * v)[1] - slaved_and_energy(network, y - h * v)[1]
    np.testing.assert_allclose((force * v).sum(dim=1).detach(), change / (2 * h), rtol=1e-6, atol=1e-7)


def test_what_changes_is_what_differences_say(network: PotentialNetwork) -> None:
    y, v, w, h = 0.5 * rows(0), rows(1), rows(2), 1e-6
    _, image, slaved, along = network.derivatives(y, v, w)
    forwards, backwards = (network.derivatives(y + s * h * v, v, w)[0] for s in (1, -1))
    np.testing.assert_allclose(image.detach(), ((forwards - backwards) / (2 * h)).detach(), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(slaved.detach(), slaved_and_energy(network, y)[0].detach(), rtol=1e-12, atol=1e-12)
    forwards, backwards = (slaved_and_energy(network, y + s * h * w)[0] for s in (1, -1))
    np.testing.assert_allclose(along.detach(), ((forwards - backwards) / (2 * h)).detach(), rtol=1e-6, atol=1e-6)


def test_the_gradient_of_a_loss_is_right_for_every_parameter(network: PotentialNetwork) -> None:
    y, v, w = 0.5 * rows(0), rows(1), rows(2)
    weights = [torch.randn(B, n, dtype=torch.float64, generator=torch.Generator().manual_seed(n)) for n in (R, K)]

    def loss() -> torch.Tensor:
        force, image, slaved, along = network.derivatives(y, v, w)
        return (force * weights[0] + image * weights[0].flip(0)).sum() + (slaved * along * weights[1]).sum()

    loss().backward()  # type: ignore[no-untyped-call]
    h = 1e-6
    for parameter in network.parameters():
        assert parameter.grad is not None
        direction = torch.randn(parameter.shape, generator=torch.Generator().manual_seed(9), dtype=torch.float64)
        with torch.no_grad():
            parameter += h * direction
            above = loss()
            parameter -= 2 * h * direction
            change = (above - loss()) / (2 * h)
            parameter += h * direction
        assert float((parameter.grad * direction).sum()) == pytest.approx(float(change), rel=1e-5, abs=1e-6)


def test_the_stress_is_that_of_the_compiled_material() -> None:
    found, expected = stresses(strains(), RATIO)[:B].numpy(), np.empty((B, 9 * POINTS))
    for i, row in enumerate(strains()[:B].numpy().reshape(B, POINTS, 9)):
        for s, (strain, ratio) in enumerate(zip(row, RATIO.tolist(), strict=True)):
            F = np.eye(3).ravel() + strain
            expected[i, 9 * s : 9 * s + 9] = energy_stress(material_number(MATERIAL), tuple(F.tolist()), 1.0, ratio)[1]
    F = np.eye(3).ravel() + strains()[:B].numpy().reshape(B, POINTS, 9)
    assert np.linalg.det(F.reshape(-1, 3, 3)).min() < -0.1  # one is inverted
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_the_change_of_the_stress_and_its_gradient_are_those_of_differences() -> None:
    at, h = strains(), 1e-6
    forwards, backwards = (stresses(torch.cat([at[:B] + s * h * at[B:], at[B:]]), RATIO)[:B] for s in (1, -1))
    np.testing.assert_allclose(stresses(at, RATIO)[B:], (forwards - backwards) / (2 * h), rtol=1e-6, atol=1e-7)
    assert torch.autograd.gradcheck(lambda x: stresses(x, RATIO), (at.requires_grad_(),))
