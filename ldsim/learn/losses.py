"""The terms of the training loss besides the squared reconstruction error, on scaled coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ldsim.learn.network import Autoencoder


def divergence(mean: torch.Tensor, log_variance: torch.Tensor) -> torch.Tensor:
    """Kullback–Leibler divergence of the codes' normal distributions from the standard one, mean over the batch."""
    per_sample: torch.Tensor = 0.5 * (mean**2 + log_variance.exp() - log_variance - 1).sum(dim=1)
    return per_sample.mean()


@dataclass(frozen=True, eq=False)
class Projectors:
    """What the equilibrium shift is computed with, made anew now and then while the decoder changes.

    Attributes:
        poses: scaled coordinates, (p, k).
        matrices: P = J(JᵀK̃J)⁻¹JᵀK̃ of each pose, (p, k, k).
        offsets: J(JᵀK̃J)⁻¹Jᵀ excess, (p, k).
    """

    poses: torch.Tensor
    matrices: torch.Tensor
    offsets: torch.Tensor


def projectors(model: Autoencoder, poses: torch.Tensor, stiffness: torch.Tensor, excess: torch.Tensor) -> Projectors:
    """The K̃-orthogonal projectors onto the decoder's tangent spaces at the codes of some poses.

    Args:
        stiffness: (p, k, k), positive semidefinite. excess: (p, k), scaled like the poses.
    """
    with torch.no_grad():
        J = model.jacobian(model.encode(poses))
        JT = J.transpose(1, 2)
        weighted = JT @ stiffness
        scale = torch.diagonal(weighted @ J, dim1=1, dim2=2).mean(dim=1)[:, None, None]
        metric = weighted @ J + 1e-6 * scale * torch.eye(J.shape[2], device=J.device)
        solved = torch.linalg.solve(metric, torch.cat([weighted, JT @ excess[:, :, None]], dim=2))
        moved = J @ solved
        return Projectors(poses, moved[:, :, :-1].contiguous(), moved[:, :, -1].contiguous())


def equilibrium_shift(model: Autoencoder, along: Projectors, batch: torch.Tensor) -> torch.Tensor:
    """How far a solid at rest at a true pose would move along the manifold, because the decoded pose has other forces.

    The forces at the decoded pose q̂ differ from the true ones by K̃(q̂ − q) + excess. The latent equilibrium answers
    by the Newton step −(JᵀK̃J)⁻¹Jᵀ(K̃(q̂ − q) + excess), in outer coordinates P(q̂ − q) + offset: the part of the error
    that Galerkin projection turns into motion. A stiff error without a soft one to go with it costs nothing here, and
    raw forces weigh exactly that.
    """
    error = model(along.poses[batch]) - along.poses[batch]
    shift = torch.bmm(along.matrices[batch], error[:, :, None])[:, :, 0] + along.offsets[batch]
    per_pose: torch.Tensor = (shift**2).sum(dim=1)
    return per_pose.mean()
