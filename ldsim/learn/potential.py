"""The network of a condensed space: V_eff(z) and the pose slaved to z, with the derivatives that a fit compares.

A fit asks for the force ∇V_eff, its change along a direction, the slaved pose and its change along another. Each is
written out, changes carried forwards and forces backwards through the layers, so that only the gradient of the loss is
left to torch: derivatives of derivatives are more operations (docs/notebook/2026-11-26-making.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from ldsim.learn.network import ACTIVATIONS, perceptron
from ldsim.learn.options import TrainOptions
from ldsim.learn.stress import stresses

# First and second derivative of each activation.
Derivative = Callable[[torch.Tensor], torch.Tensor]
DERIVATIVES: dict[str, tuple[Derivative, Derivative]] = {
    "elu": (lambda x: x.clamp_max(0).exp(), lambda x: x.clamp_max(0).exp() * (x < 0)),
    "relu": (lambda x: (x > 0).to(x.dtype), torch.zeros_like),
    "tanh": (lambda x: 1 - x.tanh().square(), lambda x: 2 * x.tanh() * (x.tanh().square() - 1)),
    "sigmoid": (
        lambda x: x.sigmoid() * (1 - x.sigmoid()),
        lambda x: x.sigmoid() * (1 - x.sigmoid()) * (1 - 2 * x.sigmoid()),
    ),
}


class PotentialNetwork(torch.nn.Module):
    """V_eff and the slaved coordinates as functions of y, in units in which the samples are of size one.

    At rest both are exact to first order by construction: the Hessian of V_eff is the identity, and the slaved
    coordinates move as T₀ does.

    Args:
        ratio: λ/μ of the material of each point, (c,).
        spread: root mean square of each slaved coordinate, (k,).
        tangents: of the slaved coordinates at rest, (r, k).
    """

    ratio: torch.Tensor
    spread: torch.Tensor
    tangents: torch.Tensor

    def __init__(
        self, ratio: torch.Tensor, spread: torch.Tensor, tangents: torch.Tensor, options: TrainOptions
    ) -> None:
        super().__init__()
        r = len(tangents)
        points, features, k = len(ratio), options.condensed.features, len(spread)
        self.features = features
        self.network = perceptron([r, *options.hidden, features + k], options.activation)
        self.activation = ACTIVATIONS[options.activation]()
        self._slope, self._curvature = DERIVATIVES[options.activation]
        # small strains, so that no point starts inverted
        self.maps = torch.nn.Parameter(0.15 / math.sqrt(r) * torch.randn(9 * points, r + features))
        self.logarithms = torch.nn.Parameter(torch.full((points,), math.log(3.0 / points)))
        last = self.network[-1]
        assert isinstance(last, torch.nn.Linear)
        torch.nn.init.normal_(last.weight, 0.0, 0.1 / math.sqrt(last.in_features))
        self.register_buffer("ratio", ratio)
        self.register_buffer("spread", spread)
        self.register_buffer("tangents", tangents)

    @property
    def layers(self) -> list[torch.nn.Linear]:
        return [each for each in self.network if isinstance(each, torch.nn.Linear)]

    def at_rest(self) -> tuple[torch.Tensor, torch.Tensor]:
        """What the network gives for y = 0, (m + k,), and its Jacobian there, (r, m + k)."""
        first, *others = self.layers
        x, J = first.bias, first.weight.T
        for layer in others:
            J = (J * self._slope(x)) @ layer.weight.T
            x = layer(self.activation(x))
        return x, J

    def derivatives(
        self, y: torch.Tensor, v: torch.Tensor, w: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """∇V_eff and its change along v, (b, r), the slaved coordinates and their change along w, (b, k).

        Args:
            y, v, w: (b, r).
        """
        b, m = len(y), self.features
        *inner, last = self.layers
        rest, J = self.at_rest()
        # of each layer its slope, what the slope changes by along v, and the directions that come out of it
        x, moved, passed = y, torch.cat([v, w]), []
        for layer in inner:
            x, moved = layer(x), moved @ layer.weight.T
            slope = self._slope(x)
            passed.append((slope, self._curvature(x) * moved[:b]))
            x, moved = self.activation(x), (moved.view(2, b, -1) * slope).view(2 * b, -1)
        outer, J_slaved = last.weight[m:] * self.spread[:, None], self.tangents - J[:, m:] * self.spread
        slaved = x @ outer.T + (last.bias[m:] - rest[m:]) * self.spread + y @ J_slaved
        along = moved[b:] @ outer.T + w @ J_slaved
        # f and its change, and the forces on [y, f]; those on f go back through the layers
        f = torch.cat([x @ last.weight[:m].T + (last.bias[:m] - rest[:m]), moved[:b] @ last.weight[:m].T])
        both = torch.cat([torch.cat([y, v]), f - torch.cat([y, v]) @ J[:, :m]], dim=1)
        forces = self._forces(both)
        r = y.shape[1]
        back = forces[:, r:] @ last.weight[:m]
        for layer, (slope, change) in zip(reversed(inner), reversed(passed), strict=True):
            at, changed = back[:b], back[b:]
            back = torch.cat([at * slope, changed * slope + at * change]) @ layer.weight
        found = forces[:, :r] + back - forces[:, r:] @ J[:, :m].T
        return found[:b], found[b:], slaved, along

    def strain_maps(self) -> torch.Tensor:
        """G of all points, (9c, r + m): the leading columns such that the Hessian at rest is the identity."""
        r = len(self.tangents)
        G = self.maps[:, :r].reshape(-1, 3, 3, r)
        trace = G[:, 0, 0] + G[:, 1, 1] + G[:, 2, 2]
        strain = 0.5 * (G + G.transpose(1, 2))
        weights = self.logarithms.exp()
        # Ψ/μ = ‖ε‖² + ½ (λ/μ) (tr ε)² for small strains
        H = 2 * torch.einsum("s,sijp,sijq->pq", weights, strain, strain)
        H = H + torch.einsum("s,sp,sq->pq", weights * self.ratio, trace, trace)
        leading = torch.linalg.solve_triangular(torch.linalg.cholesky(H), self.maps[:, :r].T, upper=False).T
        return torch.cat([leading, self.maps[:, r:]], dim=1)

    def _forces(self, both: torch.Tensor) -> torch.Tensor:
        """Those on [y, f] and their changes, (2b, r + m), for [y, f] and its changes."""
        G = self.strain_maps()
        weighted = stresses(both @ G.T, self.ratio).view(len(both), -1, 9) * self.logarithms.exp()[:, None]
        return weighted.view(len(both), -1) @ G
