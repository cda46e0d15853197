"""Training of the autoencoder in PCA coordinates (paper, Sec. 4; loss of Eq. 7), resumable.

Coordinates are scaled by one number before training. Everything random comes from one generator on the CPU whose state
is part of the checkpoint, so that an interrupted and resumed run repeats an undisturbed one, and so that CPU and CUDA
see the same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.learn.losses import Projectors, curvature, divergence, equilibrium_shift, projectors
from ldsim.learn.network import Autoencoder, extract
from ldsim.learn.optimiser import Soap
from ldsim.learn.options import Forces, Trained, TrainingOptions

Array = NDArray[np.float64]
Arrays = Mapping[str, NDArray[np.generic]]
Progress = Callable[[int, float, float], None]

# Epochs between checkpoints, and between new projectors of the equilibrium loss: one is a multiple of the other, so
# that a resumed run makes them at the same weights.
REFRESH = 10
CHECKPOINT = 50
# Poses of the equilibrium loss beside each batch.
POSES = 32
FINAL_RATE = 1e-3
# Coordinates smaller than this share of the largest are treated as if they were as large.
LEAST_SPREAD = 1e-5


class Checkpoint(Protocol):
    """Where the state of an unfinished training is kept, as plain arrays."""

    def load(self) -> Arrays | None:
        """What was saved last, or None."""

    def save(self, arrays: Arrays) -> None:
        """Replace what was saved."""


@dataclass
class _Progress:
    """The best weights so far and the losses that led there."""

    loss: list[tuple[float, float]] = field(default_factory=list)
    best: float = math.inf
    best_epoch: int = -1
    weights: dict[str, torch.Tensor] = field(default_factory=dict)

    def record(self, model: Autoencoder, training: float, validation: float) -> None:
        self.loss.append((training, validation))
        if validation < self.best:
            self.best, self.best_epoch = validation, len(self.loss) - 1
            self.weights = {name: value.clone() for name, value in model.state_dict().items()}

    def stale(self, patience: int) -> bool:
        return len(self.loss) - 1 - self.best_epoch >= patience


def train(
    q: Array,
    r: int,
    options: TrainingOptions,
    progress: Progress | None = None,
    forces: Forces | None = None,
    checkpoint: Checkpoint | None = None,
    recorded: int | None = None,
) -> Trained:
    """Train an autoencoder of latent dimension r on coordinates q, (N, k) float64.

    Args:
        progress: called after each epoch with its number, training loss and validation loss (scaled).
        forces: tangents and forces of some poses; needed where options.equilibrium is not 0.
        checkpoint: where to save the state now and then, and to go on from.
        recorded: the first so many rows are of recordings, the others rehearsed; None where all are recorded.

    Raises:
        SolverError: r is above k, there are too few snapshots to split, the data do not move or are not finite, or the
            loss is not finite.
    """
    scale = _checked_scale(q, r, options)
    fit = _Fit(q / scale, r, options, _scaled(forces, scale), recorded, ordered=False)
    fit.run(progress, checkpoint)
    return fit.result(scale, q, r)


def train_ordered(
    q: Array,
    r: int,
    options: TrainingOptions,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
    recorded: int | None = None,
) -> Callable[[int], Trained]:
    """Train r ordered codes: the result gives the autoencoder of so many leading ones.

    In each sample all but a random number of leading codes are set to 0 (nested dropout, Rippel et al. 2014), so that
    any number of leading codes is an autoencoder of its own. Arguments and errors are those of `train`.
    """
    scale = _checked_scale(q, r, options)
    fit = _Fit(q / scale, r, replace(options, equilibrium=0.0), None, recorded, ordered=True)
    fit.run(progress, checkpoint)
    return lambda codes: fit.result(scale, q, codes)


def _scaled(forces: Forces | None, scale: float) -> Forces | None:
    return None if forces is None else Forces(forces.frames, forces.stiffness, forces.excess / scale)


def _checked_scale(q: Array, r: int, options: TrainingOptions) -> float:
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


def _held_back(frames: int, options: TrainingOptions) -> int:
    return max(int(round(options.validation_share * frames)), 1)


def _repeated(rows: torch.Tensor, recorded: int, share: float) -> torch.Tensor:
    """Rows of the data with those below `recorded` so often that they are at least that share, if they are not all."""
    own, others = rows[rows < recorded], rows[rows >= recorded]
    if len(own) == 0 or len(others) == 0:
        return rows
    times = max(math.ceil(share / (1 - share) * len(others) / len(own)), 1)
    return torch.cat([own.repeat(times), others])


def _device(name: str) -> torch.device:
    """The device of that name; "auto" is CUDA where there is one."""
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name.startswith("cuda") and not torch.cuda.is_available():
        raise SolverError(f"train.device is {name}, but torch sees no CUDA device; use auto or cpu")
    return torch.device(name)


class _Fit:
    """One training: SOAP on a cosine; keeps the weights of the lowest validation loss of its last phase."""

    def __init__(
        self, q: Array, r: int, options: TrainingOptions, forces: Forces | None, recorded: int | None, ordered: bool
    ) -> None:
        self.options = options
        self.ordered = ordered
        self.device = _device(options.device)
        self.generator = torch.Generator().manual_seed(options.seed)
        data = torch.tensor(q, dtype=torch.float32)
        shuffled = torch.randperm(len(q), generator=self.generator)
        held = _held_back(len(q), options)
        kept = _repeated(shuffled[held:], len(q) if recorded is None else recorded, options.recorded_share)
        self.held, self.kept = data[shuffled[:held]].to(self.device), data[kept].to(self.device)
        spread = data.square().mean(dim=0).sqrt()
        self.spread = torch.clamp(spread / spread.max(), min=LEAST_SPREAD).to(self.device)
        self.weights = self.spread ** (-2 * options.balance)
        with torch.random.fork_rng():
            torch.manual_seed(options.seed)
            self.model = Autoencoder(r, self.spread, options).to(self.device)
        self.optimiser = Soap(self.model.parameters(), options.learning_rate)
        self.state = _Progress()
        self.forces = None if not options.equilibrium else self._tensors(q, forces)
        self.along: Projectors | None = None

    def _tensors(self, q: Array, forces: Forces | None) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        if forces is None:
            raise SolverError("train.equilibrium needs the forces of some training poses")
        arrays = (q[forces.frames], forces.stiffness, forces.excess)
        poses, stiffness, excess = (torch.tensor(a, dtype=torch.float32, device=self.device) for a in arrays)
        return poses, stiffness, excess

    def result(self, scale: float, q: Array, codes: int) -> Trained:
        """The autoencoder of the leading codes, with the best weights."""
        self.model.load_state_dict(self.state.weights)
        decoder, encoder = extract(self.model, scale, q, codes)
        return Trained(decoder, encoder, np.array(self.state.loss) * scale**2, self.state.best_epoch)

    def run(self, progress: Progress | None, checkpoint: Checkpoint | None) -> None:
        """Train to the end, from the checkpoint on if there is one."""
        options = self.options
        saved = None if checkpoint is None else checkpoint.load()
        if saved is not None:
            self.restore(saved)
        second = math.ceil(options.equilibrium_start * options.epochs / REFRESH) * REFRESH
        for epoch in range(len(self.state.loss), options.epochs):
            if checkpoint is not None and epoch % CHECKPOINT == 0 and epoch > 0:
                checkpoint.save(self.arrays())
            if self.forces is not None and epoch >= second and epoch % REFRESH == 0:
                self.along = projectors(self.model, *self.forces)
                if epoch == second:
                    self.state.best = math.inf
            training = self._epoch(epoch)
            with torch.no_grad():
                validation = float(self._reconstruction(self.held, self.model.encode(self.held)))
            if not math.isfinite(training):
                raise SolverError(f"the training loss is {training} in epoch {epoch}; lower train.learning_rate")
            self.state.record(self.model, training, validation)
            if progress is not None:
                progress(epoch, training, validation)
            if self.state.stale(options.patience):
                break

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
        for group in self.optimiser.param_groups:
            group["lr"] = rate * (FINAL_RATE + (1 - FINAL_RATE) * 0.5 * (1 + math.cos(math.pi * share)))

    def _random(self, shape: torch.Size) -> torch.Tensor:
        return torch.randn(shape, generator=self.generator).to(self.device)

    def _reconstruction(self, q: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
        """Eq. 7: the squared error in PCA coordinates, each weighted by spread^(−2 balance), mean over the batch."""
        per_sample: torch.Tensor = ((self.model.decode(z) - q).square() * self.weights).sum(dim=1)
        return per_sample.mean()

    def _losses(self, q: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The reconstruction loss of a batch and the sum of all others."""
        options, model = self.options, self.model
        other = torch.zeros((), device=self.device)
        seen = q + options.noise * self.spread * self._random(q.shape) if options.noise else q
        z = model.encode(seen)
        if options.variational:
            log_variance = model.log_variance(seen)
            other = other + options.variational * divergence(z, log_variance)
            z = z + (0.5 * log_variance).exp() * self._random(z.shape)
        if self.ordered:
            kept = torch.randint(1, model.r + 1, (len(z), 1), generator=self.generator)
            z = z * (torch.arange(model.r) < kept).to(self.device)
        if options.smoothness:
            other = other + options.smoothness * curvature(model, z, self.generator)
        if self.along is not None:
            chosen = torch.randint(0, len(self.along.poses), (POSES,), generator=self.generator).to(self.device)
            other = other + options.equilibrium * equilibrium_shift(model, self.along, chosen)
        return self._reconstruction(q, z), other

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """All that the rest of the training depends on, as plain arrays."""
        found: dict[str, NDArray[np.generic]] = {
            "loss": np.array(self.state.loss),
            "best": np.array([self.state.best, self.state.best_epoch]),
            "generator": self.generator.get_state().numpy(),
        }
        for name, value in self.model.state_dict().items():
            found[f"model/{name}"] = value.cpu().numpy()
            found[f"best_model/{name}"] = self.state.weights[name].cpu().numpy()
        for number, entry in self.optimiser.state_dict()["state"].items():
            for name, value in entry.items():
                found[f"optimiser/{number}/{name}"] = value.cpu().numpy()
        return found

    def restore(self, arrays: Arrays) -> None:
        """Continue from what `arrays` gave."""

        def group(prefix: str) -> dict[str, torch.Tensor]:
            return {
                name.removeprefix(prefix): torch.tensor(value, device=self.device)
                for name, value in arrays.items()
                if name.startswith(prefix)
            }

        self.state.loss = [(float(a), float(b)) for a, b in np.asarray(arrays["loss"])]
        best, best_epoch = np.asarray(arrays["best"])
        self.state.best, self.state.best_epoch, self.state.weights = float(best), int(best_epoch), group("best_model/")
        self.generator.set_state(torch.tensor(arrays["generator"]))
        self.model.load_state_dict(group("model/"))
        moments: dict[int, dict[str, torch.Tensor]] = {}
        for name, value in group("optimiser/").items():
            number, _, key = name.partition("/")
            moments.setdefault(int(number), {})[key] = value
        self.optimiser.load_state_dict({**self.optimiser.state_dict(), "state": moments})
