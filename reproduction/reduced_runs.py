"""What the experiments read of a run, and playing its motions in spaces of other sizes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.trajectory import Trajectory
from ldsim.pipeline.comparison import Reference, run_reduced, with_errors
from ldsim.run import Run
from ldsim.space.projection import all_coordinates
from ldsim.space.space import Space

Array = NDArray[np.float64]

PLAYED = ReducedOptions(tolerance=1e-8)


def displacements(run: Run, motion: str) -> Array:
    """All frames of a motion, (N, n, 3), metres; for small meshes."""
    snapshots = run.snapshots
    return np.asarray(snapshots.reader(motion)(0, snapshots.frames(motion)), dtype=np.float64)


def training_coordinates(run: Run) -> Array:
    """q of the training snapshots, (N, k)."""
    names = run.snapshots.with_role("train")
    return all_coordinates(lambda: run.snapshots.chunks(names), run.basis)


def largest_error(run: Run, decoded: Array) -> float:
    """Largest vertex distance, mm, of the training snapshots from U q for decoded coordinates q, (N, ≤ k)."""
    basis, largest, first = run.basis.columns(decoded.shape[1]), 0.0, 0
    for chunk in run.snapshots.chunks(run.snapshots.with_role("train")):
        off = basis.displacement(decoded[first : first + len(chunk)]) - chunk.reshape(len(chunk), -1, 3)
        largest = max(largest, float((off**2).sum(axis=2).max()))
        first += len(chunk)
    return 1e3 * float(np.sqrt(largest))


def latent(run: Run, rule: CubatureRule | None = None) -> Space:
    """The space of the run's own decoder; every quadrature point where no rule is given."""
    return Space.latent(run.scene, run.basis, (run.model.decoder, run.model.encoder), rule)


def play(
    run: Run, motion: str, space: Space, frames: int | None = None, options: ReducedOptions = PLAYED
) -> Trajectory:
    """Run a motion in a space, beside its full-space run; with errors."""
    recorded = run.recorded(motion)
    count = min(frames or recorded.motion.frames, recorded.motion.frames)
    reference = Reference(recorded.motion, recorded.held, run.snapshots.reader(motion))
    trajectory = run_reduced(ReducedStepper(space, options), reference, range(count))
    return with_errors(trajectory, trajectory, space, reference)
