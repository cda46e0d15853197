"""report.json: every number of a finished run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import cast

import numpy as np
from scipy.stats import rankdata

from ldsim.arrays import Array
from ldsim.artefacts.store import STAGE_OF
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.trajectory import Trajectory
from ldsim.report.machine import describe_machine
from ldsim.report.runs import dimensions, runs
from ldsim.report.schema import (
    MM_PER_M,
    Cubatures,
    Dimensions,
    ForceErrors,
    MachineDescription,
    MeshSize,
    MotionRun,
    NoveltyNumbers,
    OnlineError,
    Reconstruction,
    Role,
    RoleReconstructions,
    RuleNumbers,
    RunNumbers,
    SpaceRuns,
    Speedups,
    StageCost,
    VertexErrors,
    VirtualRule,
)
from ldsim.run import SPACES, Run
from ldsim.space.novelty import remembered

MS_PER_S = 1000.0


def collect(run: Run, own_cost: Mapping[str, float]) -> RunNumbers:
    """The content of report.json but its warnings, which follow from these numbers.

    Args:
        own_cost: seconds and peak_memory_mb of the report itself.

    Returns:
        What was not measured, or is not finite, is None.
    """
    mesh, decoder = run.scene.mesh, run.model.decoder
    return RunNumbers(
        experiment=run.experiment,
        created=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        machine=MachineDescription(**describe_machine()),
        mesh=MeshSize(
            vertices=mesh.n_vertices,
            cells=mesh.n_cells,
            cell_type=mesh.cell_type,
            quadrature_points=len(run.scene.points.weights),
        ),
        dims=Dimensions(k=decoder.k, r=decoder.r, kp=run.model.kp),
        reconstruction=_reconstructions(run),
        rest_residual_mm=_millimetres(_rest_residual(run)),
        cubature=Cubatures(latent=_cubature(run, "latent"), linear=_cubature(run, "linear")),
        simulate=SpaceRuns(
            **{
                space: [_motion_run(run, name, trajectory) for name, trajectory in runs(run, space).items()]
                for space in SPACES
            }
        ),
        speedup=Speedups(latent_over_linear=_speedup(run, "linear"), latent_over_full=_speedup(run, "full")),
        stages=_stages(run, own_cost),
        warnings=[],
    )


def stepped_seconds(trajectory: Trajectory) -> Array:
    """The times of the steps that were made; a run that is lost makes no more."""
    return trajectory.seconds[np.isfinite(trajectory.seconds)]


def pooled_seconds(run: Run, space: str) -> Array:
    """The times of the steps of all motions in a space, seconds."""
    return np.concatenate([np.empty(0), *(stepped_seconds(trajectory) for trajectory in runs(run, space).values())])


def _finite(value: float | None) -> float | None:
    """A plain number, or None where there is none that JSON could hold."""
    return float(value) if value is not None and math.isfinite(value) else None


def _millimetres(metres: float) -> float | None:
    return _finite(MM_PER_M * metres)


def _reconstructions(run: Run) -> RoleReconstructions:
    """Errors of the autoencoder, and of PCA with r, kp and k modes, on the poses of each role."""

    def found(autoencoder: Array, largest: Array | None, mean: Array | None) -> Reconstruction | None:
        if largest is None or mean is None:
            return None
        pca = {
            f"pca_{name}": _vertex_errors(largest[modes], mean[modes]) if modes < len(largest) else None
            for name, modes in dimensions(run).items()
        }
        return Reconstruction(autoencoder=_vertex_errors(*autoencoder), **pca)

    stored, errors = run.pca, run.model.errors
    return RoleReconstructions(
        train=found(errors[0], stored.max_error, stored.mean_error),
        heldout=found(errors[1], stored.heldout_max_error, stored.heldout_mean_error),
    )


def _vertex_errors(largest: float, mean: float) -> VertexErrors:
    """From metres."""
    return VertexErrors(max_mm=_millimetres(largest), mean_mm=_millimetres(mean))


def _rest_residual(run: Run) -> float:
    """Largest vertex displacement of U φ(0), metres."""
    decoder = run.model.decoder
    u = run.basis_of("latent").displacement(decoder(np.zeros(decoder.r)))
    return float(np.linalg.norm(u, axis=1).max())


def _cubature(run: Run, space: str) -> RuleNumbers | None:
    stored = run.cubature.get(space)
    if stored is None:
        return None
    seconds = run.header("cubature").notes.get(f"{space}_seconds")
    return RuleNumbers(
        points=len(stored.best.points),
        relative_error=_force_errors(stored.best),
        virtual=None if stored.virtual is None else _virtual(stored.virtual.rule),
        seconds=None if seconds is None else _finite(float(seconds)),
    )


def _virtual(rule: CubatureRule) -> VirtualRule:
    return VirtualRule(points=len(rule.points), relative_error=_force_errors(rule))


def _force_errors(rule: CubatureRule) -> ForceErrors:
    return ForceErrors(fitted=_finite(rule.training_error), kept_back=_finite(rule.heldout_error))


def _motion_run(run: Run, motion: str, trajectory: Trajectory) -> MotionRun:
    """Times and counts of the steps that were made, and the error over the whole motion."""
    made = np.isfinite(trajectory.seconds)
    milliseconds = MS_PER_S * trajectory.seconds[made]
    some = len(milliseconds) > 0
    return MotionRun(
        motion=motion,
        role=cast(Role, run.motions[motion].role),
        frames=int(made.sum()),
        median_step_ms=_finite(np.median(milliseconds)) if some else None,
        p95_step_ms=_finite(np.percentile(milliseconds, 95)) if some else None,
        iterations=_finite(trajectory.iterations[made].mean()) if some else None,
        evaluations=_finite(trajectory.evaluations[made].mean()) if some else None,
        online_error=_online_error(trajectory),
        novelty=_novelty(run, trajectory),
        diverged=trajectory.diverged,
    )


def _online_error(trajectory: Trajectory) -> OnlineError | None:
    """Mean vertex distance to the full space over its mean displacement, and plain; infinite means None."""
    mean, largest = trajectory.mean_error, trajectory.max_error
    if mean is None or largest is None or len(mean) == 0:
        return None
    return OnlineError(
        relative=_finite(trajectory.relative_error),
        windowed=_finite(trajectory.windowed_error),
        max_mm=_millimetres(largest.max()),
        mean_mm=_millimetres(mean.mean()),
    )


def _novelty(run: Run, trajectory: Trajectory) -> NoveltyNumbers | None:
    """The score over the motion, the share of frames above the threshold, and how well it ranks the true error."""
    if trajectory.novelty is None or run.model.novelty is None:
        return None
    scores = trajectory.novelty[np.isfinite(trajectory.novelty)]
    if len(scores) == 0:
        return None
    threshold = run.model.novelty.threshold
    return NoveltyNumbers(
        median=_finite(np.median(scores)),
        threshold=_finite(threshold),
        share_above=_finite((scores > threshold).mean()),
        rank_correlation=rank_correlation(trajectory.novelty, trajectory),
        rank_correlation_remembered=rank_correlation(remembered(trajectory.novelty, run.scene.time_step), trajectory),
    )


def rank_correlation(score: Array, trajectory: Trajectory) -> float | None:
    """Spearman's between a score and the mean vertex error of each frame; None where one is constant or not known."""
    if trajectory.mean_error is None:
        return None
    known = np.isfinite(score) & np.isfinite(trajectory.mean_error)
    score, error = rankdata(score[known]), rankdata(trajectory.mean_error[known])
    if len(score) < 3 or np.ptp(score) == 0 or np.ptp(error) == 0:
        return None
    return _finite(np.corrcoef(score, error)[0, 1])


def _speedup(run: Run, slower: str) -> float | None:
    """Median step of the slower space over that of the latent one, over all steps of the motions that both ran.

    A motion in which either diverged is left out: its steps are not of the same work.
    """
    ours, theirs = runs(run, "latent"), runs(run, slower)
    shared = [name for name in ours if name in theirs and not (ours[name].diverged or theirs[name].diverged)]
    if not shared:
        return None
    fast, slow = (
        float(np.median(np.concatenate([stepped_seconds(side[name]) for name in shared]))) for side in (ours, theirs)
    )
    return _finite(slow / fast) if fast > 0 else None


def _stages(run: Run, own_cost: Mapping[str, float]) -> dict[str, StageCost]:
    """Seconds and memory of each stage as its artefact's header has them, and the report's own."""
    notes = {STAGE_OF[kind]: run.header(kind).notes for kind in STAGE_OF} | {"report": own_cost}
    keys = tuple(StageCost.model_fields)
    return {
        stage: StageCost(**{key: _finite(float(values[key])) if key in values else None for key in keys})
        for stage, values in notes.items()
    }
