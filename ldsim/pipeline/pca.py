"""The stage pca: snapshots → the linear basis, turned by synthetic motions where some are asked for."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.artefacts.records import write_basis
from ldsim.artefacts.training import TrainingStore, remove_checkpoints
from ldsim.dynamics.synthetic import synthetic_frames, synthetic_stepper
from ldsim.jit import one_thread
from ldsim.learn.options import MANY
from ldsim.mechanics.options import PullOptions
from ldsim.mechanics.random_pulls import pulls_like, surface_pulls
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.run import Run
from ldsim.space.basis import Basis, inner_product
from ldsim.space.options import PcaOptions
from ldsim.space.pca import Pca, errors_against_k, fit_basis, turned
from ldsim.space.projection import all_coordinates

# Synthetic pulls that are run one after another; then the solid is at rest again.
PULLS_TOGETHER = 10
# How many are made of a large mesh, where that is left open, and their seed.
SYNTHETIC, SEED = 40, 11


def pca(run: Run, options: PcaOptions, progress: Progress = SILENT) -> Pca:
    """Find the linear basis of a run that has its snapshots, and write basis.h5.

    Interrupted, it keeps the spectrum and the synthetic motions.

    Raises:
        ArtefactError: scene or snapshots are missing or do not fit each other.
        SolverError: nothing moves, or the criterion cannot be met.
    """
    stage = run.stage("pca", options)
    run.require("scene", "snapshots")
    metric, partial = inner_product(run.scene.mass, options.inner_product), run.folder / "basis.partial"
    identity = f"{run.hash('scene')} {run.hash('snapshots')} {options.inner_product} {options.columns}"
    with one_thread(), progress.bar("pca", 2, "pass") as bar:
        found = fit_basis(run.chunks("train"), metric, options, TrainingStore(partial, "spectrum", identity))
        bar.update()
        if (pulls := synthetic_pulls(run, options)) is not None:
            q = all_coordinates(run.chunks("train"), found.basis)
            synthetic = _synthetic(run, found.basis, pulls, q, partial, progress)
            found = turned(found, q, synthetic, run.chunks("train"))
        if run.snapshots.with_role("validation"):
            largest, mean = errors_against_k(run.chunks("validation"), found.basis)
            found = replace(found, validation_max_error=largest, validation_mean_error=mean)
        bar.update()
    write_basis(run.path("basis"), stage.header("basis", ("scene", "snapshots")), found)
    run.written("basis")
    remove_checkpoints(partial)
    return found


def synthetic_pulls(run: Run, options: PcaOptions) -> PullOptions | None:
    """The synthetic pulls that are asked for, or where all is left open some like the motions of a large mesh."""
    if not options.is_open or run.scene.mesh.n_vertices <= MANY or run.quasistatic:
        return options.synthetic
    return pulls_like([run.recorded(name).motion for name in run.snapshots.with_role("train")], SYNTHETIC, SEED)


def _synthetic(run: Run, basis: Basis, options: PullOptions, q: Array, partial: Path, progress: Progress) -> Array:
    """Coordinates of the frames of synthetic pulls, (f, k); kept until the basis is written.

    Args:
        q: of the snapshots, to which the cubature rule is fitted that the pulls are stepped with.
    """
    digest = hashlib.sha256(q.tobytes() + basis.matrix.tobytes() + repr(options).encode())
    store = TrainingStore(partial, "synthetic", digest.hexdigest())
    kept = store.load()
    if kept is not None:
        return kept["q"].astype(np.float64)
    motion = surface_pulls("synthetic", run.scene, options)
    with progress.bar("pca: cubature rule of the synthetic motions", None, "rule") as bar:

        def show(points: int, error: float) -> None:
            bar.say(f"{points} points, relative error {error:.3f}")
            bar.update()

        stepper = synthetic_stepper(run.scene, basis, q, options.seed, show)
    with progress.bar("pca: synthetic motions", motion.frames, "frame") as bar:
        made = synthetic_frames(stepper, motion, bar.update, PULLS_TOGETHER * options.frames_of_one)
    if len(made) < motion.frames:
        lost = motion.frames - len(made)
        progress.tell(f"warning: the synthetic motions diverged and lost {lost} of {motion.frames} frames")
    store.save({"q": made})
    return made
