"""The two fits of a condensed latent space: the potential V_eff(z) and the decoder of what is slaved to z.

V_eff is a sum of hyperelastic points that see z and some learned functions of it, their strain maps fitted,

    V_eff(z) = Σ_s w_s Ψ(I + G_s [z, f(z)]),

so that it is never negative, zero at rest, where its Hessian is S₀ exactly, and grows with every strain where no
sample has been: a plain network is too soft there, and a run that leaves the samples is lost. It is fitted to
λ(z) = ∇V_eff and to products S(z) v of its Hessian with random directions, in energy coordinates y = S₀^½ z, in which
rest is equally stiff along all axes. A wrong force counts by how far it moves the solid, S⁻¹ δλ: next to buckling a
hundredth of a force is a tenth of a motion. One network gives the functions f and the decoder.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from ldsim.arrays import Array, Indices
from ldsim.cubature.rule import CubatureRule
from ldsim.errors import SolverError
from ldsim.learn.network import device_of, layers
from ldsim.learn.optimiser import Soap
from ldsim.learn.options import TrainOptions
from ldsim.learn.potential import PotentialNetwork
from ldsim.learn.stress import MATERIAL
from ldsim.mechanics.materials import material_number
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder

Watch = Callable[[int, float, float], None]

RATE, BATCH, WARM_UP = 2e-2, 128, 0.03
# Shares of the loss: products with the Hessian, the slaved pose, and its tangents, beside the forces.
HESSIAN, SLAVED, TANGENTS = 0.3, 1.0, 3.0
# What holds a solid where it would buckle, let go: grabs do, and are about as stiff as itself. A share of S₀.
HELD = 0.2
# Relative errors below this are as good as none, so that a few easy poses do not count.
SMALL = 1e-3
# Share of the poses kept back, which judge and are fitted by nothing.
KEPT_BACK = 0.1
JUDGED = 50


@dataclass(frozen=True, eq=False)
class CondensedSamples:
    """Relaxed poses, N of them.

    Attributes:
        z: (N, r). force: λ, (N, r). stiffness: S, (N, r, r).
        slaved: coordinates of u₀(z) − V z in the basis of what is slaved, (N, k).
        directions: some directions of z at each, (N, d, r); along: the slaved part of T along them, (N, d, k).
        rest_stiffness: S₀, (r, r). rest_slaved: T₀ − V in the basis of what is slaved, (r, k).
    """

    z: Array
    force: Array
    stiffness: Array
    slaved: Array
    directions: Array
    along: Array
    rest_stiffness: Array
    rest_slaved: Array


@dataclass(frozen=True, eq=False)
class Condensed:
    """What was fitted.

    Attributes:
        decoder: φ(z) = [z, f(z), slaved(z)].
        encoder: [z, 0, 0] → z.
        potential: the virtual points of V_eff, whose maps see the leading coordinates of φ alone.
        loss: of the fit, and the relative force error on the poses kept back, each time it was judged, (j, 2).
    """

    decoder: Decoder
    encoder: Encoder
    potential: CubatureRule
    loss: Array


def fit_condensed(
    samples: CondensedSamples, moduli: tuple[Indices, Array, Array], options: TrainOptions, watch: Watch
) -> Condensed:
    """Fit potential and decoder.

    Args:
        moduli: quadrature points that give the virtual points their moduli, (c,), with μ and λ there, Pa.
        watch: told the step, the loss, and the relative force error on the poses kept back, `JUDGED` times.

    Raises:
        SolverError: there are too few samples, the loss is not finite, or the device asked for is not there.
    """
    fit = _Fit(samples, moduli, options)
    losses = []
    for step in range(options.condensed.steps):
        loss = fit.step(step)
        if not math.isfinite(loss):
            raise SolverError(f"the loss of the condensed space is {loss} in step {step}; relax more poses")
        if (step + 1) % max(options.condensed.steps // JUDGED, 1) == 0:
            losses.append((loss, fit.error(fit.kept_back)))
            watch(step + 1, *losses[-1])
    return fit.result(np.array(losses).reshape(-1, 2))


class _Fit:
    """SOAP on a warm-up and half a cosine; all in float64, for Hessians lose digits."""

    def __init__(self, samples: CondensedSamples, moduli: tuple[Indices, Array, Array], options: TrainOptions) -> None:
        count, r = samples.z.shape
        if count < 10:
            raise SolverError(f"only {count} relaxed poses to fit a condensed space to; at least 10 are needed")
        self.samples, self.options, self.moduli = samples, options, moduli
        self.device = device_of(options.device)
        values, vectors = np.linalg.eigh(samples.rest_stiffness)
        root = (vectors * np.sqrt(values)) @ vectors.T
        inverse = np.linalg.inv(root)
        self.unit = float(np.sqrt(np.mean(np.sum((samples.z @ root) ** 2, axis=1))))
        self.to_y = root / self.unit
        self.generator = torch.Generator().manual_seed(options.seed)
        self.y = self._tensor(samples.z @ self.to_y)
        self.force = self._tensor(samples.force @ inverse / self.unit)
        hessian = inverse @ samples.stiffness @ inverse
        self.hessian = self._tensor(hessian)
        values, vectors = np.linalg.eigh(hessian)
        self.softness = self._tensor((vectors / (np.abs(values) + HELD)[:, None]) @ vectors.transpose(0, 2, 1))
        self.slaved, self.along = self._tensor(samples.slaved), self._tensor(samples.along)
        self.directions = self._tensor(samples.directions @ self.to_y)
        shuffled = torch.randperm(count, generator=self.generator)
        held = max(round(KEPT_BACK * count), 1)
        self.kept_back, self.fitted = shuffled[:held], shuffled[held:]
        spread = torch.tensor(samples.slaved).square().mean(dim=0).sqrt()
        ratio = torch.tensor(moduli[2] / moduli[1])
        tangents = torch.tensor(np.linalg.inv(self.to_y) @ samples.rest_slaved)
        with torch.random.fork_rng():
            torch.manual_seed(options.seed)
            shape = ratio, spread.clamp_min(0.01 * float(spread.max())), tangents
            self.model = PotentialNetwork(*shape, options).double().to(self.device)
        self.optimiser = Soap(self.model.parameters(), RATE)
        # a relative error near rest would count rounding: what is smaller than a share of the median counts as that
        self.floors = [float(share * x.norm(dim=-1).median()) for share, x in self._sizes()]

    def _tensor(self, values: Array) -> torch.Tensor:
        return torch.tensor(values, device=self.device)

    def _sizes(self) -> tuple[tuple[float, torch.Tensor], ...]:
        return (0.1, self.y), (0.3, self.hessian[:, :, 0]), (0.2, self.slaved), (0.3, self.along)

    def step(self, number: int) -> float:
        """One gradient; the loss."""
        share = number / self.options.condensed.steps
        rate = min(share / WARM_UP, 1.0) * 0.5 * (1 + math.cos(math.pi * share)) + 1e-3
        for group in self.optimiser.param_groups:
            group["lr"] = RATE * rate
        chosen = torch.randint(0, len(self.fitted), (BATCH,), generator=self.generator)
        loss = self._loss(self.fitted[chosen])
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
        self.optimiser.step()
        return float(loss.detach())

    def _loss(self, batch: torch.Tensor) -> torch.Tensor:
        model, generator = self.model, self.generator
        # numbers are drawn on the processor, so that a graphics card sees the same poses and directions
        v = torch.randn((len(batch), self.y.shape[1]), generator=generator, dtype=self.y.dtype).to(self.device)
        one = torch.randint(0, self.directions.shape[1], (len(batch),), generator=generator).to(self.device)
        batch = batch.to(self.device)
        v = v / v.norm(dim=1, keepdim=True)
        w = self.directions[batch, one]
        force, image, slaved, along = model.derivatives(self.y[batch], v, w)
        expected = torch.einsum("bij,bj->bi", self.hessian[batch], v)
        moved = torch.einsum("bij,bj->bi", self.softness[batch], force - self.force[batch])
        floors = self.floors
        loss: torch.Tensor = (
            _relative(self.y[batch] + moved, self.y[batch], floors[0])
            + HESSIAN * _relative(image, expected, floors[1])
            + SLAVED * _relative(slaved, self.slaved[batch], floors[2])
            + TANGENTS * _relative(along, self.along[batch, one], floors[3])
        )
        return loss

    def error(self, poses: torch.Tensor) -> float:
        """‖λ_fit − λ‖ / ‖λ‖ in energy coordinates, the median over some poses."""
        poses = poses.to(self.device)
        y = self.y[poses]
        with torch.no_grad():
            force = self.model.derivatives(y, 0 * y, 0 * y)[0]
        wrong = (force - self.force[poses]).norm(dim=1) / self.force[poses].norm(dim=1)
        return float(wrong.median())

    def result(self, loss: Array) -> Condensed:
        errors = [self.error(poses) for poses in (self.fitted, self.kept_back)]
        model, F = self.model.cpu(), self.to_y
        r, m, spread = len(F), model.features, model.spread.numpy()
        weights, biases = layers(model.network)
        # y = to_y z is folded into the first layer, the spread into the last; z itself comes by the skip
        weights[0] = F @ weights[0]
        out = np.concatenate([np.ones(m), spread])
        weights[-1] = np.hstack([np.zeros((len(weights[-1]), r)), weights[-1] * out])
        biases[-1] = np.concatenate([np.zeros(r), biases[-1] * out])
        skip = np.hstack([np.eye(r), -F @ model.at_rest()[1].detach().numpy() * out])
        skip[:, r + m :] += self.samples.rest_slaved
        decoder = Decoder.network(weights, biases, self.options.activation, skip)
        select = np.vstack([np.eye(r), np.zeros((decoder.k - r, r))])
        return Condensed(decoder, Encoder((select,), (np.zeros(r),)), self._rule(r, decoder.k, errors), loss)

    def _rule(self, r: int, k: int, errors: list[float]) -> CubatureRule:
        points, mu, _ = self.moduli
        maps = np.zeros((len(points), 9, k))
        fitted = self.model.strain_maps().detach().numpy()
        maps[:, :, : r + self.model.features] = fitted.reshape(len(points), 9, -1)
        maps[:, :, :r] = maps[:, :, :r] @ self.to_y
        weights = self.unit**2 * self.model.logarithms.detach().exp().numpy() / mu
        return CubatureRule(points, weights, errors[0], maps, errors[1], material=material_number(MATERIAL))


def _relative(found: torch.Tensor, wanted: torch.Tensor, floor: float) -> torch.Tensor:
    """‖found − wanted‖ / (‖wanted‖ + floor), mean over a batch: outliers count once, not squared."""
    share = (found - wanted).square().sum(dim=1) / (wanted.norm(dim=1) + floor).square()
    mean: torch.Tensor = (share + SMALL**2).sqrt().mean()
    return mean
