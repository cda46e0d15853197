"""The optimiser: what it must beat, where it must stop, and what it must keep."""

from __future__ import annotations

import torch

from ldsim.learn.optimiser import EVERY, Soap


def ill_conditioned(seed: int = 0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """A and B of the loss ½‖A W B − C‖² with condition numbers of 100 in directions that no axis shows, and C."""
    generator = torch.Generator().manual_seed(seed)
    Q, R = (torch.linalg.qr(torch.randn(8, 8, generator=generator))[0] for _ in range(2))
    stretch = torch.logspace(0, -2, 8)
    return Q * stretch @ Q.T, R * stretch @ R.T, torch.randn(8, 8, generator=generator)


def loss_after(make: type[torch.optim.Optimizer], steps: int) -> float:
    A, B, W = ill_conditioned()
    C, weight = A @ W @ B, torch.nn.Parameter(torch.zeros(8, 8))
    optimiser = make([weight], lr=0.05)  # type: ignore[call-arg]
    for step in range(steps):
        optimiser.param_groups[0]["lr"] = 0.05 * (1 - step / steps)
        optimiser.zero_grad()
        (0.5 * (A @ weight @ B - C).square().sum()).backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    return float((A @ weight @ B - C).detach().square().sum() / C.square().sum())


def test_a_badly_conditioned_matrix_is_found_closer_than_by_adam() -> None:
    assert loss_after(Soap, 300) < 0.1 * loss_after(torch.optim.Adam, 300)


def test_a_turned_problem_takes_the_turned_steps() -> None:
    generator = torch.Generator().manual_seed(1)
    Q, R = (torch.linalg.qr(torch.randn(5, 5, generator=generator, dtype=torch.float64))[0] for _ in range(2))
    plain, turned = (torch.nn.Parameter(torch.zeros(5, 5, dtype=torch.float64)) for _ in range(2))
    first, second = Soap([plain], 0.01), Soap([turned], 0.01)
    for _ in range(EVERY + 3):
        gradient = torch.randn(5, 5, generator=generator, dtype=torch.float64)
        plain.grad, turned.grad = gradient, Q @ gradient @ R
        first.step()
        second.step()
    torch.testing.assert_close(turned.detach(), Q @ plain.detach() @ R)


def test_parameters_without_a_gradient_stay() -> None:
    still = torch.nn.Parameter(torch.ones(3, 2))
    Soap([still], 0.1).step()
    assert (still == 1).all()


def test_it_goes_on_from_its_state_as_if_it_had_not_stopped() -> None:
    generator = torch.Generator().manual_seed(2)
    gradients = torch.randn(2 * EVERY + 5, 4, 6, generator=generator)
    undisturbed, resumed = (torch.nn.Parameter(torch.zeros(4, 6)) for _ in range(2))
    optimiser = Soap([undisturbed], 0.01)
    for gradient in gradients:
        undisturbed.grad = gradient
        optimiser.step()
    part = Soap([resumed], 0.01)
    for i, gradient in enumerate(gradients):
        if i == EVERY + 2:
            part, before = Soap([resumed], 0.01), part
            part.load_state_dict(before.state_dict())
        resumed.grad = gradient
        part.step()
    assert torch.equal(undisturbed, resumed)
