"""Adam in the eigenbasis of Shampoo's preconditioner (SOAP; Vyas et al. 2024, arXiv 2409.11321).

The gradient G of a weight matrix is rotated into the eigenvectors of the running means of GGᵀ and GᵀG, in which its
entries are nearly uncorrelated, and Adam takes its step there. These networks are small and their loss badly
conditioned, so the rotations are cheap and save most of the steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch

# Decay of both moments and of the covariances, and steps between new eigenvectors.
DECAY = 0.95
EVERY = 10
TINY = 1e-8


class Soap(torch.optim.Optimizer):
    """SOAP for matrices, Adam for vectors.

    All of its state is contiguous tensors: a product with the same numbers in another order of memory rounds otherwise,
    and a training that goes on from a checkpoint would not repeat an undisturbed one.
    """

    def __init__(self, parameters: Iterable[torch.nn.Parameter], lr: float) -> None:
        super().__init__(parameters, {"lr": lr})

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # type: ignore[override]
        """One step with the gradients that the parameters hold; parameters without one stay."""
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter.grad is not None:
                    self._move(parameter, parameter.grad, group["lr"])

    def _move(self, parameter: torch.Tensor, gradient: torch.Tensor, rate: float) -> None:
        state = self.state[parameter]
        if not state:
            state["step"] = torch.zeros(())
            state["mean"], state["square"] = torch.zeros_like(gradient), torch.zeros_like(gradient)
            if gradient.dim() == 2:
                state["left"], state["right"] = gradient @ gradient.T, gradient.T @ gradient
                for side in ("left", "right"):
                    state[f"{side}_basis"] = torch.linalg.eigh(state[side])[1].contiguous()
                    state[side] *= 1 - DECAY
        state["step"] += 1
        count = int(state["step"])
        state["mean"].lerp_(gradient, 1 - DECAY)
        rate *= math.sqrt(1 - DECAY**count) / (1 - DECAY**count)
        if gradient.dim() != 2:
            state["square"].mul_(DECAY).addcmul_(gradient, gradient, value=1 - DECAY)
            parameter.sub_(state["mean"] / (state["square"].sqrt() + TINY), alpha=rate)
            return
        left, right = state["left_basis"], state["right_basis"]
        rotated = left.T @ gradient @ right
        state["square"].mul_(DECAY).addcmul_(rotated, rotated, value=1 - DECAY)
        direction = (left.T @ state["mean"] @ right) / (state["square"].sqrt() + TINY)
        parameter.sub_(left @ direction @ right.T, alpha=rate)
        for side, product in (("left", gradient @ gradient.T), ("right", gradient.T @ gradient)):
            state[side].lerp_(product, 1 - DECAY)
            if count % EVERY == 0:
                # One step of the power method: the eigenvectors turn slowly.
                state[f"{side}_basis"] = torch.linalg.qr(state[side] @ state[f"{side}_basis"])[0].contiguous()
