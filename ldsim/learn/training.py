"""Training of the autoencoder in PCA coordinates (paper, Sec. 4; loss of Eq. 7), resumable.

Coordinates are scaled by one number before training. Everything random comes from one generator on the CPU whose state
is part of the checkpoint, so that an interrupted and resumed run repeats an undisturbed one, and so that CPU and CUDA
see the same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.errors import SolverError
from ldsim.learn.examples import Examples
from ldsim.learn.losses import Projectors, divergence, equilibrium_shift, projectors
from ldsim.learn.network import Autoencoder, device_of, extract
from ldsim.learn.optimiser import Soap
from ldsim.learn.options import TrainOptions
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.pca import Kept

Arrays = Mapping[str, NDArray[np.generic]]
# Told after each epoch: its number, training loss and validation loss (scaled).
Watch = Callable[[int, float, float], None]

# Epochs between checkpoints, and between new projectors of the equilibrium loss: one is a multiple of the other, so
# that a resumed run makes them at the same weights.
REFRESH = 10
CHECKPOINT = 50
# Poses of the equilibrium loss beside each batch.
POSES = 32
FINAL_RATE = 1e-3
OPTIMISERS = {"soap": Soap, "adam": torch.optim.Adam}
# Coordinates smaller than this share of the largest are treated as if they were as large.
LEAST_SPREAD = 1e-5


@dataclass(frozen=True, eq=False)
class Trained:
    """A trained autoencoder.

    Attributes:
        decoder, encoder: φ and ψ in float64.
        loss: weighted mean squared error in PCA coordinates after each epoch, (epochs, 2) float64 for training and
            validation.
        best_epoch: the epoch whose weights were kept.
    """

    decoder: Decoder
    encoder: Encoder
    loss: Array
    best_epoch: int


def train(
    examples: Examples,
    r: int,
    options: TrainOptions,
    watch: Watch | None = None,
    checkpoint: Kept | None = None,
) -> Trained:
    """Train an autoencoder of latent dimension r; options.r and what else is of the search are not looked at.

    Args:
        checkpoint: where to save the state now and then, and to go on from.

    Raises:
        SolverError: r is above k, there are too few examples to split, they do not move or are not finite, forces are
            missing, or the loss is not finite.
    """
    fit = _Fit(examples, r, options)
    fit.run(watch, checkpoint)
    return fit.result(r)


def train_ordered(
    examples: Examples,
    r: int,
    options: TrainOptions,
    watch: Watch | None = None,
    checkpoint: Kept | None = None,
) -> Callable[[int], Trained]:
    """Train r ordered codes: the result gives the autoencoder of so many leading ones.

    In each sample all but a random number of leading codes are set to 0 (nested dropout, Rippel et al. 2014), so that
    any number of leading codes is an autoencoder of its own. Arguments and errors are those of `train`; the equilibrium
    term is left out.
    """
    fit = _Fit(examples, r, options.replace(equilibrium=None), ordered=True)
    fit.run(watch, checkpoint)
    return fit.result


def _checked_scale(q: Array, r: int, options: TrainOptions) -> float:
    """The number that coordinates are divided by, or a refusal."""
    frames, k = q.shape
    if not 1 <= r <= k:
        raise SolverError(f"latent dimension r = {r}; allowed are 1 … k = {k}")
    if frames - _held_back(frames, options) < 2:
        raise SolverError(f"{frames} training snapshots are too few to split into training and validation")
    if not np.isfinite(q).all():
        frame = int(np.argwhere(~np.isfinite(q))[0, 0])
        raise SolverError(f"training snapshot {frame} is not finite; rerun snapshot")
    scale = float(np.sqrt((q**2).mean(axis=0).max()))
    if not scale > 0:
        raise SolverError("the training snapshots do not move; there is nothing to learn")
    return scale


def _held_back(frames: int, options: TrainOptions) -> int:
    return max(int(round(options.validation_share * frames)), 1)


def _repeated(frames: torch.Tensor, recorded: int, share: float) -> torch.Tensor:
    """Frames with those below `recorded` so often that they are at least that share, if they are not all."""
    own, others = frames[frames < recorded], frames[frames >= recorded]
    if len(own) == 0 or len(others) == 0:
        return frames
    times = max(math.ceil(share / (1 - share) * len(others) / len(own)), 1)
    return torch.cat([own.repeat(times), others])


class _Fit:
    """One training; keeps the weights of the lowest validation loss of its last phase."""

    def __init__(self, examples: Examples, r: int, options: TrainOptions, ordered: bool = False) -> None:
        self.scale, self.examples = _checked_scale(examples.q, r, options), examples
        self.options, self.ordered, self.device = options, ordered, device_of(options.device)
        self.generator = torch.Generator().manual_seed(options.seed)
        data = torch.tensor(examples.q / self.scale, dtype=torch.float32)
        shuffled = torch.randperm(len(data), generator=self.generator)
        held = _held_back(len(data), options)
        kept = _repeated(shuffled[held:], examples.recorded, options.recorded_share)
        self.held, self.kept = data[shuffled[:held]].to(self.device), data[kept].to(self.device)
        spread = data.square().mean(dim=0).sqrt()
        self.spread = torch.clamp(spread / spread.max(), min=LEAST_SPREAD).to(self.device)
        self.weights = self.spread ** (-2 * options.balance)
        with torch.random.fork_rng():
            torch.manual_seed(options.seed)
            self.model = Autoencoder(r, self.spread, options).to(self.device)
        self.optimiser: torch.optim.Optimizer = OPTIMISERS[options.optimiser](
            self.model.parameters(), lr=options.learning_rate
        )
        self.losses: list[tuple[float, float]] = []
        self.best, self.best_epoch, self.best_weights = math.inf, -1, dict[str, torch.Tensor]()
        self.forces = self._forces() if options.equilibrium else None
        self.along: Projectors | None = None

    def _forces(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Poses, tangents and excess forces, scaled as the data are."""
        forces = self.examples.forces
        if forces is None:
            raise SolverError("train.equilibrium needs the forces of some training poses")
        arrays = (self.examples.q[forces.frames] / self.scale, forces.stiffness, forces.excess / self.scale)
        poses, stiffness, excess = (torch.tensor(a, dtype=torch.float32, device=self.device) for a in arrays)
        return poses, stiffness, excess

    def result(self, codes: int) -> Trained:
        """The autoencoder of the leading codes, with the best weights."""
        self.model.load_state_dict(self.best_weights)
        decoder, encoder = extract(self.model, self.scale, self.examples.q, codes)
        return Trained(decoder, encoder, np.array(self.losses) * self.scale**2, self.best_epoch)

    def run(self, watch: Watch | None, checkpoint: Kept | None) -> None:
        """Train to the end, from the checkpoint on if there is one."""
        options = self.options
        saved = None if checkpoint is None else checkpoint.load()
        if saved is not None:
            self.restore(saved)
        for epoch in range(len(self.losses), options.epochs):
            if checkpoint is not None and epoch % CHECKPOINT == 0 and epoch > 0:
                checkpoint.save(self.arrays())
            self._renew_projectors(epoch)
            training = self._epoch(epoch)
            with torch.no_grad():
                validation = float(self._reconstruction(self.held, self.model.encode(self.held)))
            if not math.isfinite(training):
                raise SolverError(f"the training loss is {training} in epoch {epoch}; lower train.learning_rate")
            self.losses.append((training, validation))
            if validation < self.best:
                self.best, self.best_epoch = validation, epoch
                self.best_weights = {name: value.clone() for name, value in self.model.state_dict().items()}
            if watch is not None:
                watch(epoch, training, validation)
            if options.patience is not None and epoch - self.best_epoch >= options.patience:
                break

    def _renew_projectors(self, epoch: int) -> None:
        """Those of the equilibrium term, from its first epoch on; weights from before it are not kept."""
        if self.forces is None or self.options.equilibrium is None:
            return
        first = math.ceil(self.options.equilibrium.start * self.options.epochs / REFRESH) * REFRESH
        if epoch >= first and epoch % REFRESH == 0:
            self.along = projectors(self.model, *self.forces)
            if epoch == first:
                self.best = math.inf

    def _epoch(self, epoch: int) -> float:
        """One pass over the snapshots; the mean reconstruction loss."""
        options, total = self.options, torch.zeros((), device=self.device)
        batches = torch.split(torch.randperm(len(self.kept), generator=self.generator), options.batch)
        for i, batch in enumerate(batches):
            self._set_rate((epoch + i / len(batches)) / options.epochs)
            self.optimiser.zero_grad(set_to_none=True)
            reconstruction, other = self._losses(self.kept[batch.to(self.device)])
            (reconstruction + other).backward()  # type: ignore[no-untyped-call]
            self.optimiser.step()
            total += reconstruction.detach() * len(batch)
        return float(total) / len(self.kept)

    def _set_rate(self, share: float) -> None:
        rate = self.options.learning_rate
        if self.options.schedule == "fixed":
            return
        for group in self.optimiser.param_groups:
            group["lr"] = rate * (FINAL_RATE + (1 - FINAL_RATE) * 0.5 * (1 + math.cos(math.pi * share)))

    def _random(self, shape: torch.Size) -> torch.Tensor:
        return torch.randn(shape, generator=self.generator).to(self.device)

    def _reconstruction(self, q: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
        """Eq. 7: the squared error in PCA coordinates, each weighted by spread^(−2 balance), mean over the batch."""
        per_sample: torch.Tensor = ((self.model.decode(z) - q).square() * self.weights).sum(dim=1)
        return per_sample.mean()

    def _losses(self, q: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The reconstruction loss of a batch and the sum of all other terms."""
        options, model = self.options, self.model
        other = torch.zeros((), device=self.device)
        seen = q + options.denoising.noise * self.spread * self._random(q.shape) if options.denoising else q
        z = model.encode(seen)
        if options.variational:
            log_variance = model.log_variance(seen)
            other = other + options.variational.weight * divergence(z, log_variance)
            z = z + (0.5 * log_variance).exp() * self._random(z.shape)
        if self.ordered:
            kept = torch.randint(1, model.r + 1, (len(z), 1), generator=self.generator)
            z = z * (torch.arange(model.r) < kept).to(self.device)
        if options.equilibrium and self.along is not None:
            chosen = torch.randint(0, len(self.along.poses), (POSES,), generator=self.generator).to(self.device)
            other = other + options.equilibrium.weight * equilibrium_shift(model, self.along, chosen)
        return self._reconstruction(q, z), other

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """All that the rest of the training depends on, as plain arrays."""
        groups: dict[str, Mapping[str, torch.Tensor]] = {
            "model": self.model.state_dict(),
            "best_model": self.best_weights,
            **{f"optimiser/{i}": state for i, state in self.optimiser.state_dict()["state"].items()},
        }
        return {
            "loss": np.array(self.losses),
            "best": np.array([self.best, self.best_epoch]),
            "generator": self.generator.get_state().numpy(),
            **{f"{group}/{name}": t.cpu().numpy() for group, tensors in groups.items() for name, t in tensors.items()},
        }

    def restore(self, arrays: Arrays) -> None:
        """Continue from what `arrays` gave."""
        groups: dict[str, dict[str, torch.Tensor]] = {}
        for path, value in arrays.items():
            group, _, name = path.rpartition("/")
            groups.setdefault(group, {})[name] = torch.tensor(value, device=self.device)
        self.losses = [(float(a), float(b)) for a, b in np.asarray(arrays["loss"])]
        best, best_epoch = np.asarray(arrays["best"])
        self.best, self.best_epoch, self.best_weights = float(best), int(best_epoch), groups["best_model"]
        self.generator.set_state(torch.tensor(arrays["generator"]))
        self.model.load_state_dict(groups["model"])
        state = {int(group.split("/")[1]): value for group, value in groups.items() if group.startswith("optimiser/")}
        self.optimiser.load_state_dict({**self.optimiser.state_dict(), "state": state})
