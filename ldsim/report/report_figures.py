"""The figures of a finished run."""

from __future__ import annotations

import numpy as np

from ldsim.artefacts.records import StoredCubature
from ldsim.report.errors import MM_PER_M, ErrorSummary
from ldsim.report.figures import (
    CubatureCurve,
    ErrorCurve,
    StepTime,
    cubature_error,
    error_against_k,
    online_error_over_time,
    singular_values,
    step_times,
    training_history,
    trust_over_time,
)
from ldsim.report.finished_run import FinishedRun
from ldsim.report.report_numbers import MS_PER_S, pooled_seconds, rank_correlation
from ldsim.report.report_schema import SPACES
from ldsim.space.novelty import remembered


def draw_figures(run: FinishedRun, cubature_tolerance: float | None) -> dict[str, str]:
    """Name → SVG text of every figure that the run has data for, as `page.render_page` knows them."""
    figures = {"error_against_k": _error_against_k(run)}
    figures["singular_values"] = singular_values(run.basis.singular_values, run.marks)
    figures["training"] = _training(run)
    if run.cubature:
        curves = [_cubature_curve(space, stored) for space, stored in run.cubature.items()]
        figures["cubature"] = cubature_error(curves, cubature_tolerance)
    times = {space: pooled_seconds(run, space) for space in SPACES}
    bars = {
        space: StepTime(MS_PER_S * float(np.median(seconds)), MS_PER_S * float(np.percentile(seconds, 95)))
        for space, seconds in times.items()
        if len(seconds)
    }
    if bars:
        figures["step_times"] = step_times(bars)
    return figures | _online_errors(run) | _trust(run)


def _error_against_k(run: FinishedRun) -> str:
    stored = run.basis
    modes = np.arange(len(stored.max_error), dtype=np.float64)
    train = ErrorCurve(MM_PER_M * stored.max_error, MM_PER_M * stored.mean_error)
    heldout = None
    if stored.heldout_max_error is not None and stored.heldout_mean_error is not None:
        heldout = ErrorCurve(MM_PER_M * stored.heldout_max_error, MM_PER_M * stored.heldout_mean_error)
    largest, mean = (float(MM_PER_M * error) for error in run.model.errors[0])
    return error_against_k(modes, train, heldout, run.marks, ErrorSummary(largest, mean))


def _training(run: FinishedRun) -> str:
    loss = run.model.loss
    return training_history(np.arange(1.0, len(loss) + 1), loss[:, 0], loss[:, 1])


def _cubature_curve(space: str, stored: StoredCubature) -> CubatureCurve:
    points = np.array([len(entry.points) for entry in stored.ladder], dtype=np.float64)
    training = np.array([entry.training_error for entry in stored.ladder])
    heldout = stored.heldout_errors if np.isfinite(stored.heldout_errors).any() else None
    return CubatureCurve(space, points, training, heldout)


def _online_errors(run: FinishedRun) -> dict[str, str]:
    """One figure a motion; frame i is the state at (i + 1) h, and a drag pulls from the beginning of its first step."""
    h = run.scene.time_step
    figures = {}
    for name, recorded in run.recorded.items():
        curves = {
            space: MM_PER_M * trajectory.mean_error
            for space, trajectory in run.reduced_runs(name).items()
            if trajectory.mean_error is not None
        }
        if not curves:
            continue
        seconds = h * np.arange(1.0, recorded.motion.frames + 1)
        grabs = [(h * drag.start, h * drag.stop) for drag in recorded.motion.drags]
        figures[f"online_error_{name}"] = online_error_over_time(seconds, curves, grabs, name)
    return figures


def _trust(run: FinishedRun) -> dict[str, str]:
    """One figure a motion that the latent space ran with a score."""
    figures = {}
    for name, trajectory in run.runs("latent").items():
        if run.model.novelty is None or trajectory.novelty is None or trajectory.mean_error is None:
            continue
        seconds = run.scene.time_step * np.arange(1.0, len(trajectory.novelty) + 1)
        error, memory = MM_PER_M * trajectory.mean_error, remembered(trajectory.novelty, run.scene.time_step)
        correlation = rank_correlation(memory, trajectory)
        figures[f"trust_{name}"] = trust_over_time(
            seconds, (trajectory.novelty, memory), error, run.model.novelty.threshold, correlation, name
        )
    return figures
