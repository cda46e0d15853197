"""The incremental potential of many instances of one reduced model at once: value, gradient and exact Hessian.

    E(z) = ½ (q − q̂)ᵀ M̃/h² (q − q̂) + Σ_s w_s Ψ(F_s) − f̃·q + Σ ½ k ‖c₀ + B q − target‖²,  q = φ(z)

as `dynamics.reduced.potential` has it (paper, Eq. 12), with grabs, gravity and material of each instance's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ldsim.arrays import Array
from ldsim.dynamics.batched.decoder import BatchedDecoder
from ldsim.dynamics.batched.materials import Material, twins
from ldsim.dynamics.batched.warped import BatchedSeries, Pulled, Swing, pulled
from ldsim.dynamics.reduced.matrices import reduced_mass
from ldsim.dynamics.reduced.moving_pins import MovingPins
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.space.space import Space

# Beyond it products are not finite.
LARGEST = 1e50


class BatchedLoads(NamedTuple):
    """What acts on each of n instances in a step, g springs each.

    B (n, g, 3, k) and centre (n, g, 3), m: the centroid of what a grab holds is centre + B q. target (n, g, 3), m.
    stiffness (n, g), N/m; zero for no grab. gravity (n, 3), m/s². mu, lam (n,): factors of the scene's Lamé parameters;
    the same factor in both scales Young's modulus. a (n, l): where moved pins are (`space.lifting`); change (n, l):
    aₙ₊₁ − 2aₙ + aₙ₋₁, which the step fills in. follows (n, m): a of modes that swing (space/modes.py), filled in too.
    series: of a condensed space, whose B and centre the step fills in too, what else it knows of the grabs; there a
    stiffness of zero has no slope.
    """

    B: Tensor
    centre: Tensor
    target: Tensor
    stiffness: Tensor
    gravity: Tensor
    mu: Tensor
    lam: Tensor
    a: Tensor
    change: Tensor
    follows: Tensor
    series: BatchedSeries | None = None

    def of(self, instances: Tensor | slice) -> BatchedLoads:
        """Those of some instances."""
        series = None if self.series is None else self.series.of_instances(instances)
        return BatchedLoads._make([*(values[instances] for values in self.tensors), series])

    def in_series(self, q: Tensor, swing: Swing | None = None, stepping: bool = True) -> Pulled:
        """What the grabs of a condensed space do at q, (n, k), in a step where modes swing, or at q itself.

        An instance that has a number that is not finite gets springs that are not, so that its step is lost; the
        others, and their gradients, do not notice.
        """
        assert self.series is not None
        own = self.target.flatten(1), self.stiffness, self.gravity, self.mu[:, None], q
        fine = torch.cat([each.detach().abs() < LARGEST for each in own], dim=1).all(1)

        def kept(values: Tensor, other: float) -> Tensor:
            return torch.where(fine.reshape(-1, *[1] * (values.dim() - 1)), values, other)

        target, stiffness, gravity = (kept(each, 0.0) for each in (self.target, self.stiffness, self.gravity))
        if swing is not None:
            swing = Swing._make([*(kept(each, 0.0) for each in swing[:-1]), swing.turns])
        softness = 1 / kept(self.mu, 1.0)
        found = pulled(self.series, target, stiffness, gravity, softness, kept(q, 0.0), swing, stepping)
        return Pulled(*(kept(each, torch.nan) for each in found))

    def serial(self, instance: int) -> Loads:
        """What a condensed instance is held by and its gravity, for `ReducedStepper`; moduli are the stepper's."""
        assert self.series is not None
        which = self.series.which[instance].tolist()
        target, stiffness, gravity = (
            each[instance].detach().cpu().numpy().astype(np.float64)
            for each in (self.target, self.stiffness, self.gravity)
        )
        pulling = [j for j, number in enumerate(which) if number >= 0 and stiffness[j] > 0]
        grabs = tuple(Grab(self.series.held[which[j]], target[j], float(stiffness[j])) for j in pulling)
        return Loads(grabs, gravity)

    @property
    def tensors(self) -> tuple[Tensor, ...]:
        """All but the series."""
        return tuple(self[:-1])


class Part(NamedTuple):
    """Cubature points of one material."""

    material: Material
    points: slice


@dataclass(frozen=True, eq=False)
class BatchedModel:
    """A reduced model on tensors; its points are sorted by material.

    Attributes:
        G: ∂F/∂q of every point, (9, k, c), 1/m.
        weights (c,) m³; mu, lam (c,) Pa.
        inertia: M̃/h², (k, k). weight: the force of gravity 1 m/s² along each axis, Uᵀ M, (3, k), kg.
        load: the scene's dead load, (k,), N.
        lifted: ∂F/∂a of every point, (9, l, c); momentum: UᵀML/h², (k, l). l is 0 where all pins stand still.
        squares: ω² of modes that swing, the last of q, (m,) 1/s²; rate: 1/h². turns: of these, as `Swing` has it.
    """

    decoder: BatchedDecoder
    parts: tuple[Part, ...]
    G: Tensor
    weights: Tensor
    mu: Tensor
    lam: Tensor
    inertia: Tensor
    weight: Tensor
    load: Tensor
    lifted: Tensor
    momentum: Tensor
    squares: Tensor
    rate: float
    turns: bool

    @classmethod
    def of(cls, space: Space, device: torch.device, dtype: torch.dtype) -> BatchedModel:
        def tensor(values: Array) -> Tensor:
            return torch.as_tensor(np.ascontiguousarray(values), dtype=dtype, device=device)

        space = space.by_material()
        scene, basis, rule = space.scene, space.reduced_basis, space.rule
        elements, pins, points = rule.elements(scene), MovingPins.of(space), rule.points
        kinds, starts = np.unique(elements.kind, return_index=True)
        stops = [*starts[1:], len(points)]
        return cls(
            BatchedDecoder.of(space.decoder, device, dtype),
            tuple(
                Part(material, slice(int(start), int(stop)))
                for material, start, stop in zip(twins(kinds.tolist()), starts, stops, strict=True)
            ),
            tensor(rule.strain_maps(scene, basis.matrix).transpose(1, 2, 0)),
            tensor(np.asarray(rule.weights)),
            tensor(elements.mu),
            tensor(elements.lam),
            tensor(reduced_mass(scene, basis) / scene.time_step**2),
            tensor(np.einsum("v,vik->ik", scene.vertex_mass, basis.fields)),
            tensor(basis.matrix.T @ scene.force(np.zeros(3)).ravel()),
            tensor(pins.strain.transpose(1, 2, 0)),
            tensor(pins.inertia),
            tensor(space.squares),
            1 / scene.time_step**2,
            space.turns,
        )

    def swing(self, loads: BatchedLoads, q: Tensor, predictor: Tensor) -> Swing | None:
        """How modes move in a step from q, (n, k), where there are some; loads need not know a yet."""
        if not len(self.squares):
            return None

        def kept(values: Tensor, other: float) -> Tensor:
            """Without what a lost instance may have, of which gradients would be no numbers."""
            return torch.where(values.abs() < LARGEST, values, other)

        q, predictor, gravity = kept(q, 0.0), kept(predictor, 0.0), kept(loads.gravity, 0.0)
        squares = kept(loads.mu, 1.0)[:, None] * self.squares
        gives = 1 / (squares + self.rate)
        follows, modes = squares * gives, len(self.squares)
        force = (gravity @ self.weight + self.load)[:, -modes:]
        swung = (1 - follows) * predictor[:, -modes:] + gives * force
        relaxed = self.decoder(q[:, : self.decoder.r])  # a condensed space decodes z to itself
        return Swing(follows, gives, swung, 1 / squares, force / squares, relaxed, self.turns)

    def _following(self, values: Tensor, loads: BatchedLoads) -> Tensor:
        """Values of all coordinates, (n, …, k), those of modes a times."""
        modes = len(self.squares)
        if not modes:
            return values
        shares = loads.follows.reshape(len(values), *[1] * (values.dim() - 2), modes)
        return torch.cat([values[..., :-modes], shares * values[..., -modes:]], dim=-1)

    def _strains(self, q: Tensor, loads: BatchedLoads) -> Tensor:
        """F of every point, (3, 3, n, c)."""
        F = torch.matmul(q, self.G)
        if self.lifted.shape[1]:
            F = F + torch.matmul(loads.a, self.lifted)
        F[::4] += 1
        return F.reshape(3, 3, *F.shape[1:])

    def _parts(self, loads: BatchedLoads) -> Iterator[tuple[Material, slice, Tensor, Tensor]]:
        """Each material with its points and their moduli in every instance, (n, c)."""
        for material, points in self.parts:
            yield (
                material,
                points,
                loads.mu[:, None] * self.mu[points],
                loads.lam[:, None] * self.lam[points],
            )

    def _stresses(self, loads: BatchedLoads, F: Tensor) -> Tensor:
        """w P of every point, (9, n, c)."""
        parts = [material.stress(F[..., at], mu, lam) for material, at, mu, lam in self._parts(loads)]
        return (torch.cat(parts, dim=-1) * self.weights).flatten(0, 1)

    def _force(self, loads: BatchedLoads, predictor: Tensor, q: Tensor, F: Tensor) -> Tensor:
        """∂E/∂q, (n, k), N."""
        elastic = torch.matmul(self._stresses(loads, F), self.G.transpose(1, 2)).sum(0)
        springs = torch.einsum("ng,ngi,ngik->nk", loads.stiffness, self._pulls(loads, q), loads.B)
        return self._following((q - predictor) @ self.inertia, loads) - self.dead(loads) + elastic + springs

    def dead(self, loads: BatchedLoads) -> Tensor:
        """Weight and load, and what moving pins take along, (n, k), N."""
        return self._following(loads.gravity @ self.weight + self.load - loads.change @ self.momentum.T, loads)

    @staticmethod
    def _pulls(loads: BatchedLoads, q: Tensor) -> Tensor:
        """c(q) − target of every spring, (n, g, 3), m."""
        return loads.centre - loads.target + torch.einsum("ngik,nk->ngi", loads.B, q)

    def value_gradient(self, loads: BatchedLoads, predictor: Tensor, z: Tensor) -> tuple[Tensor, Tensor]:
        """E(z), J, (n,), and its gradient, N, (n, r); E is infinite, never NaN, where it is not defined.

        Args:
            predictor: q̂ = 2qₙ − qₙ₋₁, (n, k).
        """
        q, outputs = self.decoder.forward(z)
        F, offset = self._strains(q, loads), q - predictor
        value = 0.5 * (self._following(offset @ self.inertia, loads) * offset).sum(1) - (self.dead(loads) * q).sum(1)
        value = value + 0.5 * (loads.stiffness * (self._pulls(loads, q) ** 2).sum(2)).sum(1)
        for material, at, mu, lam in self._parts(loads):
            value = value + material.density(F[..., at], mu, lam) @ self.weights[at]
        gradient, _ = self.decoder.pull_back(outputs, self._force(loads, predictor, q, F))
        return torch.where(value < torch.inf, value, torch.inf), gradient

    def hessian(self, loads: BatchedLoads, predictor: Tensor, z: Tensor) -> Tensor:
        """∂²E/∂z², (n, r, r): exact, the decoder's second derivative included, and not clamped."""
        at = self.decoder.tangents(z)
        J, F = at.jacobian, self._strains(at.q, loads)
        X = torch.matmul(J, self.G[:, None]).reshape(3, 3, *J.shape[:2], -1)
        T = torch.cat(
            [
                material.tangent(F[..., None, part], X[..., part], mu[:, None], lam[:, None])
                for material, part, mu, lam in self._parts(loads)
            ],
            dim=-1,
        )
        H = torch.matmul((T * self.weights).flatten(0, 1), X.flatten(0, 1).transpose(-1, -2)).sum(0)
        BJ = torch.einsum("ngik,nrk->ngir", loads.B, J)
        H = H + self._following(J @ self.inertia, loads) @ J.transpose(1, 2)
        H = H + torch.einsum("ng,ngia,ngib->nab", loads.stiffness, BJ, BJ)
        H = H + self.decoder.curvature(at, self._force(loads, predictor, at.q, F))
        return 0.5 * (H + H.transpose(1, 2))

    def virtual_work(self, loads: BatchedLoads, predictor: Tensor, q: Tensor, y: Tensor) -> Tensor:
        """Σ over instances of y · ∂E/∂q at q, J; differentiable in all that acts."""
        return (y * self._force(loads, predictor, q, self._strains(q, loads))).sum()
