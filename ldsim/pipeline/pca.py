"""The stage pca: snapshots → the linear basis."""

from __future__ import annotations

from dataclasses import replace

from ldsim.artefacts.records import write_basis
from ldsim.artefacts.training import TrainingStore, remove_checkpoints
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.run import Run
from ldsim.space.basis import inner_product
from ldsim.space.options import PcaOptions
from ldsim.space.pca import Pca, errors_against_k, fit_basis


def pca(run: Run, options: PcaOptions, progress: Progress = SILENT) -> Pca:
    """Find the linear basis of a run that has its snapshots, and write basis.h5; interrupted, it keeps the spectrum.

    Raises:
        ArtefactError: scene or snapshots are missing or do not fit each other.
        SolverError: nothing moves, or the criterion cannot be met.
    """
    stage = run.stage("pca", options)
    run.require("scene", "snapshots")
    metric, partial = inner_product(run.scene.mass, options.inner_product), run.folder / "basis.partial"
    identity = f"{run.hash('scene')} {run.hash('snapshots')} {options.inner_product} {options.k}"
    with progress.bar("pca", 2, "pass") as bar:
        found = fit_basis(run.chunks("train"), metric, options, TrainingStore(partial, "spectrum", identity))
        bar.update()
        if run.snapshots.with_role("heldout"):
            largest, mean = errors_against_k(run.chunks("heldout"), found.basis)
            found = replace(found, heldout_max_error=largest, heldout_mean_error=mean)
        bar.update()
    write_basis(run.path("basis"), stage.header("basis", ("scene", "snapshots")), found)
    run.written("basis")
    remove_checkpoints(partial)
    return found
