"""Playing the motions of a run in reduced spaces of any size, judged by the full space."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.trajectory import Trajectory
from ldsim.pipeline.comparison import Reference, restarts_every, run_reduced, with_errors
from ldsim.run import Run
from ldsim.space.projection import all_coordinates
from ldsim.space.space import Space
from reproduction.rivals.every_element import EveryElement

PLAYED = ReducedOptions(tolerance=1e-8)
# Seconds between restarts from the full space, of the windowed error.
WINDOW = 0.25


def displacements(run: Run, motion: str) -> Array:
    """All frames of a motion, (N, n, 3), metres; for small meshes."""
    snapshots = run.played
    return np.asarray(snapshots.reader(motion)(0, snapshots.frames(motion)), dtype=np.float64)


def training_coordinates(run: Run) -> Array:
    """q of the training snapshots, (N, k)."""
    return all_coordinates(run.chunks("train"), run.basis)


def largest_error(run: Run, decoded: Array) -> float:
    """Largest vertex distance, mm, of the training snapshots from U q for decoded coordinates q, (N, ≤ k)."""
    basis, largest, first = run.basis.columns(decoded.shape[1]), 0.0, 0
    for chunk in run.snapshots.chunks(run.snapshots.with_role("train")):
        off = basis.displacement(decoded[first : first + len(chunk)]) - chunk.reshape(len(chunk), -1, 3)
        largest = max(largest, float((off**2).sum(axis=2).max()))
        first += len(chunk)
    return 1e3 * float(np.sqrt(largest))


def layers(run: Run) -> str:
    """Widths of the hidden layers of its decoder, in words."""
    return " ".join(map(str, run.model.decoder.layers.sizes[1:-1]))


def latent(run: Run) -> Space:
    """The space of the run's own decoder, with every quadrature point."""
    return Space.latent(run.scene, run.basis, (run.model.decoder, run.model.encoder))


def reference(run: Run, motion: str, frames: int | None = None) -> Reference:
    """A motion, or its first frames, as it ran in the full space."""
    recorded = run.recorded(motion)
    moved = recorded.motion if frames is None else recorded.motion.first(frames)
    return Reference(moved, recorded.held, run.played.reader(motion))


def play(
    run: Run, motion: str, space: Space, frames: int | None = None, options: ReducedOptions = PLAYED
) -> Trajectory:
    """Run a motion in a space, beside its full-space run; with errors, but none windowed."""
    return played(ReducedStepper(space, options), reference(run, motion, frames))


def played(stepper: ReducedStepper | EveryElement, full: Reference, window: float | None = None) -> Trajectory:
    """A motion with its errors, where a window is given also restarted from the full space every so many seconds."""
    stepper = cast(ReducedStepper, stepper)  # every element has all that is asked of it
    whole, windowed = run_reduced(stepper, full), None
    if window is not None:
        restarts = restarts_every(full.motion, stepper.scene, window)
        windowed = run_reduced(stepper, full, restarts=restarts)
    return with_errors(whole, stepper.space, full, windowed)


def online_error(found: Trajectory) -> float:
    """Mean vertex distance to the full-space run over its mean displacement; NaN where nothing moved."""
    return float("nan") if found.relative_error is None else found.relative_error


def a_step(counts: NDArray[np.integer], found: Trajectory) -> float:
    """Iterations or evaluations of a step, on average over those that were taken before a run was lost."""
    return float(counts[np.isfinite(found.seconds) & (found.evaluations > 0)].mean())
