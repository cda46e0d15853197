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

from ldsim.arrays import Array, Indices, Numbers
from ldsim.cubature.rule import CubatureRule
from ldsim.errors import SolverError
from ldsim.learn.optimiser import Soap
from ldsim.learn.options import TrainOptions
from ldsim.learn.potential import Derivatives, PotentialNetwork, Strains
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
        SolverError: there are too few samples, or the loss is not finite.
    """
    fit = _Fit(samples, moduli, options)
    losses = []
    for step in range(options.condensed.steps):
        loss = fit.step(step)
        if (step + 1) % max(options.condensed.steps // JUDGED, 1) == 0:
            losses.append((loss, fit.error(fit.kept_back)))
            watch(step + 1, *losses[-1])
    return fit.result(np.array(losses).reshape(-1, 2))


class _Fit:
    """SOAP on a warm-up and half a cosine, in single precision: what a batch leaves out is far more than rounding."""

    def __init__(self, samples: CondensedSamples, moduli: tuple[Indices, Array, Array], options: TrainOptions) -> None:
        count, r = samples.z.shape
        if count < 10:
            raise SolverError(f"only {count} relaxed poses to fit a condensed space to; at least 10 are needed")
        self.samples, self.options, self.moduli = samples, options, moduli
        values, vectors = np.linalg.eigh(samples.rest_stiffness)
        root = (vectors * np.sqrt(values)) @ vectors.T
        inverse = np.linalg.inv(root)
        self.unit = float(np.sqrt(np.mean(np.sum((samples.z @ root) ** 2, axis=1))))
        self.to_y = root / self.unit
        self.generator = torch.Generator().manual_seed(options.seed)
        hessian = inverse @ samples.stiffness @ inverse
        values, vectors = np.linalg.eigh(hessian)
        softness = (vectors / (np.abs(values) + HELD)[:, None]) @ vectors.transpose(0, 2, 1)
        self.y, self.force = _single(samples.z @ self.to_y), _single(samples.force @ inverse / self.unit)
        self.hessian, self.softness = _single(hessian), _single(softness)
        self.slaved, self.along = _single(samples.slaved), _single(samples.along)
        self.directions = _single(samples.directions @ self.to_y)
        shuffled = torch.randperm(count, generator=self.generator).numpy()
        held = max(round(KEPT_BACK * count), 1)
        self.kept_back, self.fitted = shuffled[:held], shuffled[held:]
        spread = np.sqrt((samples.slaved**2).mean(axis=0))
        tangents = np.linalg.inv(self.to_y) @ samples.rest_slaved
        with torch.random.fork_rng():
            torch.manual_seed(options.seed)
            known = moduli[2] / moduli[1], np.maximum(spread, 0.01 * spread.max()), tangents
            self.model = PotentialNetwork.drawn(*known, options).in_precision(np.float32)
        # the optimiser sees the memory of the network's own arrays
        self.parameters = [torch.nn.Parameter(torch.from_numpy(each)) for each in self.model.parameters]
        self.optimiser = Soap(self.parameters, RATE)
        # a relative error near rest would count rounding: what is smaller than a share of the median counts as that
        self.floors = [float(share * np.median(np.linalg.norm(x, axis=-1))) for share, x in self._sizes()]

    def _sizes(self) -> tuple[tuple[float, Numbers], ...]:
        return (0.1, self.y), (0.3, self.hessian[:, :, 0]), (0.2, self.slaved), (0.3, self.along)

    def step(self, number: int) -> float:
        """One gradient; the loss."""
        share = number / self.options.condensed.steps
        rate = min(share / WARM_UP, 1.0) * 0.5 * (1 + math.cos(math.pi * share)) + 1e-3
        for group in self.optimiser.param_groups:
            group["lr"] = RATE * rate
        chosen = torch.randint(0, len(self.fitted), (BATCH,), generator=self.generator).numpy()
        v = torch.randn((BATCH, self.y.shape[1]), generator=self.generator, dtype=torch.float32).numpy()
        v /= np.linalg.norm(v, axis=1, keepdims=True)
        one = torch.randint(0, self.directions.shape[1], (BATCH,), generator=self.generator).numpy()
        loss, gradient = self._gradient(self.fitted[chosen], v, one)
        for parameter, slope in zip(self.parameters, gradient, strict=True):
            parameter.grad = torch.from_numpy(slope)
        torch.nn.utils.clip_grad_norm_(self.parameters, 1.0)
        self.optimiser.step()
        return loss

    def _gradient(self, batch: Indices, v: Numbers, one: Indices) -> tuple[float, list[Numbers]]:
        """The mean loss of some poses along directions v and one of those at each, and its gradient.

        Raises:
            SolverError: the loss is not finite.
        """
        found, tape = self.model.derivatives(self.y[batch], v, self.directions[batch, one], self._strains())
        loss, counts = self._loss(found, batch, v, one)
        if not math.isfinite(loss):
            raise SolverError(f"the loss of the condensed space is {loss}; relax more poses")
        return loss, self.model.gradient(tape, counts)

    def _strains(self) -> Strains:
        """Those of V_eff as it is now.

        Raises:
            SolverError: its maps have become singular.
        """
        try:
            return self.model.strains()
        except np.linalg.LinAlgError:
            raise SolverError("the strain maps of the condensed space have become singular; relax more poses") from None

    def _loss(self, found: Derivatives, poses: Indices, v: Numbers, one: Indices) -> tuple[float, Derivatives]:
        """The mean over some poses, and its gradient by each of the derivatives."""
        y, softness, floors = self.y[poses], self.softness[poses], self.floors
        moved = np.matvec(softness, found.force - self.force[poses])
        image = np.matvec(self.hessian[poses], v)
        terms = (
            (1.0, moved, y, floors[0]),
            (HESSIAN, found.image - image, image, floors[1]),
            (SLAVED, found.slaved - self.slaved[poses], self.slaved[poses], floors[2]),
            (TANGENTS, found.along - self.along[poses, one], self.along[poses, one], floors[3]),
        )
        losses, counts = zip(*(_relative(*term) for term in terms), strict=True)
        return sum(losses), Derivatives(np.matvec(softness, counts[0]), *counts[1:])

    def error(self, poses: Indices) -> float:
        """‖λ_fit − λ‖ / ‖λ‖ in energy coordinates, the median over some poses."""
        y, force = self.y[poses], self.force[poses]
        found = self.model.derivatives(y, 0 * y, 0 * y, self._strains())[0].force
        return float(np.median(np.linalg.norm(found - force, axis=1) / np.linalg.norm(force, axis=1)))

    def result(self, loss: Array) -> Condensed:
        errors = [self.error(poses) for poses in (self.fitted, self.kept_back)]
        model, F = self.model.in_precision(np.float64), self.to_y  # what is exact at rest is so in double precision
        r, m, spread = len(F), model.features, model.spread
        weights, biases = list(model.weights), list(model.biases)
        # y = to_y z is folded into the first layer, the spread into the last; z itself comes by the skip
        weights[0] = F @ weights[0]
        out = np.concatenate([np.ones(m), spread])
        weights[-1] = np.hstack([np.zeros((len(weights[-1]), r)), weights[-1] * out])
        biases[-1] = np.concatenate([np.zeros(r), biases[-1] * out])
        skip = np.hstack([np.eye(r), -F @ model.at_rest() * out])
        skip[:, r + m :] += self.samples.rest_slaved
        decoder = Decoder.network(weights, biases, self.options.nonlinearity, skip)
        select = np.vstack([np.eye(r), np.zeros((decoder.k - r, r))])
        return Condensed(
            decoder, Encoder((select,), (np.zeros(r),)), self._rule(model.strains(), decoder.k, errors), loss
        )

    def _rule(self, strains: Strains, k: int, errors: list[float]) -> CubatureRule:
        points, mu, _ = self.moduli
        r, maps = len(self.to_y), np.zeros((len(points), 9, k))
        maps[:, :, : strains.maps.shape[1]] = strains.maps.reshape(len(points), 9, -1)
        maps[:, :, :r] = maps[:, :, :r] @ self.to_y
        weights = self.unit**2 * strains.weights / mu
        return CubatureRule(points, weights, errors[0], maps, errors[1], material=material_number(MATERIAL))


def _single(values: Array) -> Numbers:
    return np.ascontiguousarray(values, dtype=np.float32)


def _relative(weight: float, wrong: Numbers, wanted: Numbers, floor: float) -> tuple[float, Numbers]:
    """The weighted mean of ‖wrong‖ / (‖wanted‖ + floor), where outliers count once, not squared; and its gradient."""
    scale = (np.linalg.norm(wanted, axis=1) + floor) ** 2
    share = np.sqrt((wrong**2).sum(axis=1) / scale + SMALL**2)
    return weight * float(share.mean()), (weight / len(wrong) / (scale * share))[:, None] * wrong
