"""report.json: every number of a finished run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from ldsim.artefacts.records import StoredCubature
from ldsim.cubature.ladder import VirtualSelection
from ldsim.dynamics.trajectory import Trajectory
from ldsim.report.errors import MM_PER_M
from ldsim.report.finished_run import FinishedRun
from ldsim.report.machine import describe_machine
from ldsim.report.report_schema import SPACES
from ldsim.space.novelty import remembered

Array = NDArray[np.float64]

MS_PER_S = 1000.0


def collect(run: FinishedRun, own_cost: Mapping[str, float]) -> dict[str, Any]:
    """The content of report.json but its warnings, which follow from these numbers.

    Args:
        own_cost: seconds and peak_memory_mb of the report itself.

    Returns:
        As `report_schema.check_report` demands; what was not measured, or is not finite, is None.
    """
    mesh, decoder = run.scene.mesh, run.model.decoder
    return {
        "experiment": run.experiment,
        "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "machine": describe_machine(),
        "mesh": {
            "vertices": mesh.n_vertices,
            "cells": mesh.n_cells,
            "cell_type": mesh.cell_type,
            "quadrature_points": len(run.scene.points.weights),
        },
        "dims": {"k": decoder.k, "r": decoder.r, "kp": run.model.kp},
        "reconstruction": {"train": _training_reconstruction(run), "heldout": _heldout_reconstruction(run)},
        "rest_residual_mm": _finite(MM_PER_M * _rest_residual(run)),
        "cubature": {space: _cubature(run, space) for space in ("latent", "linear")},
        "simulate": {
            space: [_simulation(run, name, trajectory) for name, trajectory in run.runs(space).items()]
            for space in SPACES
        },
        "speedup": {f"latent_over_{slower}": _speedup(run, slower) for slower in ("linear", "full")},
        "stages": _stages(run, own_cost),
    }


def stepped_seconds(trajectory: Trajectory) -> Array:
    """The times of the steps that were made; a run that is lost makes no more."""
    return trajectory.seconds[np.isfinite(trajectory.seconds)]


def pooled_seconds(run: FinishedRun, space: str) -> Array:
    """The times of the steps of all motions in a space, seconds."""
    return np.concatenate([np.empty(0), *(stepped_seconds(trajectory) for trajectory in run.runs(space).values())])


def _finite(value: float | None) -> float | None:
    """A plain number, or None where there is none that JSON could hold."""
    return float(value) if value is not None and math.isfinite(value) else None


def _training_reconstruction(run: FinishedRun) -> dict[str, Any]:
    basis = run.basis
    return _reconstruction(run, run.model.errors[0], basis.max_error, basis.mean_error)


def _heldout_reconstruction(run: FinishedRun) -> dict[str, Any] | None:
    largest, mean = run.basis.heldout_max_error, run.basis.heldout_mean_error
    if largest is None or mean is None:
        return None
    return _reconstruction(run, run.model.errors[1], largest, mean)


def _reconstruction(run: FinishedRun, autoencoder: Array, largest: Array, mean: Array) -> dict[str, Any]:
    """Errors of the autoencoder, (2,) metres, and of PCA with r, kp and k modes, from (k + 1,) metres each."""

    def errors(max_m: float, mean_m: float) -> dict[str, float | None]:
        return {"max_mm": _finite(MM_PER_M * max_m), "mean_mm": _finite(MM_PER_M * mean_m)}

    pca = {
        f"pca_{name}": errors(largest[modes], mean[modes]) if modes < len(largest) else None
        for name, modes in run.marks.items()
    }
    return {"autoencoder": errors(*autoencoder), **pca}


def _rest_residual(run: FinishedRun) -> float:
    """Largest vertex displacement of U φ(0), metres."""
    decoder = run.model.decoder
    u = run.basis.basis.matrix @ decoder(np.zeros(decoder.r))
    return float(np.linalg.norm(u.reshape(-1, 3), axis=1).max())


def _cubature(run: FinishedRun, space: str) -> dict[str, Any] | None:
    stored: StoredCubature | None = run.cubature.get(space)
    if stored is None:
        return None
    seconds = run.headers["cubature"].notes.get(f"{space}_seconds")
    return {
        "points": len(stored.best.points),
        "relative_error": {
            "train": _finite(stored.best.training_error),
            "heldout": _finite(stored.heldout_errors[stored.chosen]),
        },
        "virtual": None if stored.virtual is None else _virtual(stored.virtual),
        "seconds": None if seconds is None else _finite(float(seconds)),
    }


def _virtual(found: VirtualSelection) -> dict[str, Any]:
    errors = {"train": _finite(found.cubature.training_error), "heldout": _finite(found.heldout_error)}
    return {"points": len(found.cubature.points), "relative_error": errors}


def _simulation(run: FinishedRun, motion: str, trajectory: Trajectory) -> dict[str, Any]:
    """Times and counts of the steps that were made, and the error over the whole motion."""
    made = np.isfinite(trajectory.seconds)
    milliseconds = MS_PER_S * trajectory.seconds[made]
    some = len(milliseconds) > 0
    return {
        "motion": motion,
        "role": run.recorded[motion].role,
        "frames": int(made.sum()),
        "median_step_ms": _finite(np.median(milliseconds)) if some else None,
        "p95_step_ms": _finite(np.percentile(milliseconds, 95)) if some else None,
        "iterations": _finite(trajectory.iterations[made].mean()) if some else None,
        "evaluations": _finite(trajectory.evaluations[made].mean()) if some else None,
        "online_error": _online_error(trajectory),
        "trust": _trust(run, trajectory),
        "diverged": trajectory.diverged,
    }


def _online_error(trajectory: Trajectory) -> dict[str, float | None] | None:
    """Mean vertex distance to the full space over its mean displacement, and plain; infinite means None."""
    mean, largest = trajectory.mean_error, trajectory.max_error
    if mean is None or largest is None or len(mean) == 0:
        return None
    moved, windowed = trajectory.mean_displacement, trajectory.windowed_mean_error
    return {
        "relative": _ratio(mean, moved),
        "windowed": _ratio(windowed, moved),
        "max_mm": _finite(MM_PER_M * largest.max()),
        "mean_mm": _finite(MM_PER_M * mean.mean()),
    }


def _trust(run: FinishedRun, trajectory: Trajectory) -> dict[str, float | None] | None:
    """The score over the motion, the share of distrusted frames, and how well it ranks the true error."""
    if trajectory.novelty is None or run.model.novelty is None:
        return None
    known = np.isfinite(trajectory.novelty)
    scores = trajectory.novelty[known]
    if len(scores) == 0:
        return None
    threshold = run.model.novelty.threshold
    return {
        "median": _finite(np.median(scores)),
        "threshold": _finite(threshold),
        "distrusted": _finite((scores > threshold).mean()),
        "rank_correlation": rank_correlation(trajectory.novelty, trajectory),
        "rank_correlation_remembered": rank_correlation(
            remembered(trajectory.novelty, run.scene.time_step), trajectory
        ),
    }


def rank_correlation(score: Array, trajectory: Trajectory) -> float | None:
    """Spearman's between a score and the mean vertex error of each frame; None where one is constant or not known."""
    if trajectory.mean_error is None:
        return None
    known = np.isfinite(score) & np.isfinite(trajectory.mean_error)
    score, error = rankdata(score[known]), rankdata(trajectory.mean_error[known])
    if len(score) < 3 or np.ptp(score) == 0 or np.ptp(error) == 0:
        return None
    return _finite(np.corrcoef(score, error)[0, 1])


def _ratio(error: Array | None, moved: Array | None) -> float | None:
    """Σ error / Σ moved over the frames, or None where one is not known or nothing moved."""
    if error is None or moved is None or not moved.sum() > 0:
        return None
    return _finite(error.sum() / moved.sum())


def _speedup(run: FinishedRun, slower: str) -> float | None:
    """Median step of the slower space over that of the latent one, over all steps of the motions that both ran.

    A motion in which either diverged is left out: its steps are not of the same work.
    """
    ours, theirs = run.runs("latent"), run.runs(slower)
    shared = [name for name in ours if name in theirs and not (ours[name].diverged or theirs[name].diverged)]
    if not shared:
        return None
    fast, slow = (
        float(np.median(np.concatenate([stepped_seconds(side[name]) for name in shared]))) for side in (ours, theirs)
    )
    return _finite(slow / fast) if fast > 0 else None


def _stages(run: FinishedRun, own_cost: Mapping[str, float]) -> dict[str, Any]:
    """Seconds and memory of each stage as its artefact's header has them, and the report's own."""
    notes = {str(header.notes["stage"]): header.notes for header in run.headers.values()} | {"report": own_cost}
    return {
        stage: {key: _finite(float(values[key])) if key in values else None for key in ("seconds", "peak_memory_mb")}
        for stage, values in notes.items()
    }
