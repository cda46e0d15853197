"""report.json: every number of a finished run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import cast

import numpy as np
from scipy.stats import rankdata

from ldsim.arrays import Array
from ldsim.artefacts.store import STAGE_OF, WRITTEN_BY
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.trajectory import Trajectory
from ldsim.pipeline.choice_of_space import equal_error
from ldsim.pipeline.comparison import stretch
from ldsim.pipeline.convergence import read_rounds
from ldsim.pipeline.options import SimulateOptions
from ldsim.pipeline.statement import BEFORE, LEFT_OUT, about, bound, sentence
from ldsim.report import schema
from ldsim.report.frontier import MS_PER_S, advice, dimension, judged, points, spaces
from ldsim.report.machine import describe_machine
from ldsim.report.options import ReportOptions
from ldsim.report.repeat import configuration
from ldsim.report.runs import dimensions, runs
from ldsim.report.schema import MM_PER_M, Role, RunNumbers
from ldsim.run import REDUCED, SPACES, Run
from ldsim.space.novelty import remembered
from ldsim.space.pca import errors_against_k
from ldsim.space.projection import reconstruction_error


def collect(run: Run, options: ReportOptions, own_cost: Mapping[str, float]) -> RunNumbers:
    """The content of report.json but its verdict, warnings and remedies, which follow from these numbers.

    Args:
        own_cost: seconds and peak_memory_mb of the report itself.

    Returns:
        What was not measured, or is not finite, is None.
    """
    mesh, decoder = run.scene.mesh, run.model.decoder
    return RunNumbers(
        experiment=run.experiment,
        verdict=schema.Verdict(word="not judged", why=""),
        created=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        machine=schema.MachineDescription(**describe_machine()),
        mesh=schema.MeshSize(
            vertices=mesh.n_vertices,
            cells=mesh.n_cells,
            cell_type=mesh.cell_type,
            quadrature_points=len(run.scene.points.weights),
        ),
        kind="condensed" if run.model.condensed else "autoencoder",
        dims=schema.Dimensions(k=decoder.k, r=decoder.r, kp=run.model.kp),
        reconstruction=_reconstructions(run),
        rest_residual_mm=_millimetres(_rest_residual(run)),
        cubature=schema.Cubatures(latent=_cubature(run, "latent"), linear=_cubature(run, "linear")),
        simulate=schema.SpaceRuns(
            **{
                space: [_motion_run(run, name, trajectory) for name, trajectory in runs(run, space).items()]
                for space in SPACES
            }
        ),
        window_seconds=SimulateOptions.of_dump(run.header("simulation").settings).window,
        space=run.chosen,
        frontier=_frontier(run),
        speedup=_speedups(run),
        statement=_statement(run),
        rounds=[schema.LearningRound(**each.model_dump()) for each in read_rounds(run.folder)],
        made_from=schema.MadeFrom(configuration=configuration(run), settings=options.dump(), inputs=_inputs(run)),
        stages=_stages(run, own_cost),
        warnings=[],
        advice=advice(run),
        remedies=[],
    )


def pooled_seconds(run: Run, space: str) -> Array:
    """The times of the steps of all motions in a space, seconds; a run that is lost makes no more."""
    seconds: Array = np.concatenate([np.empty(0), *(trajectory.seconds for trajectory in runs(run, space).values())])
    return seconds[np.isfinite(seconds)]


def _finite(value: float | None) -> float | None:
    """A plain number, or None where there is none that JSON could hold."""
    return float(value) if value is not None and math.isfinite(value) else None


def _millimetres(metres: float) -> float | None:
    return _finite(MM_PER_M * metres)


def _reconstructions(run: Run) -> schema.RoleReconstructions:
    """Errors of the autoencoder, and of PCA with r, kp and k modes, on the poses of each role."""

    def found(autoencoder: Array, largest: Array | None, mean: Array | None) -> schema.Reconstruction | None:
        if largest is None or mean is None:
            return None
        pca = {
            f"pca_{name}": _vertex_errors(largest[modes], mean[modes]) if modes < len(largest) else None
            for name, modes in dimensions(run).items()
        }
        return schema.Reconstruction(autoencoder=_vertex_errors(*autoencoder), **pca)

    stored, errors = run.pca, run.model.errors
    return schema.RoleReconstructions(
        train=found(errors[0], stored.max_error, stored.mean_error),
        validation=found(errors[1], stored.validation_max_error, stored.validation_mean_error),
        test=found(*_on_tests(run)),
    )


def _on_tests(run: Run) -> tuple[Array, Array | None, Array | None]:
    """The same of the test motions, of which no artefact knows: of the decoder, and largest and mean of PCA by k."""
    if not run.played.with_role("test"):
        return np.full(2, np.nan), None, None
    networks = run.model.encoder, run.model.decoder
    reached = reconstruction_error(run.chunks("test"), run.basis_of("latent"), *networks)
    return np.array(reached), *errors_against_k(run.chunks("test"), run.basis)


def _vertex_errors(largest: float, mean: float) -> schema.VertexErrors:
    """From metres."""
    return schema.VertexErrors(max_mm=_millimetres(largest), mean_mm=_millimetres(mean))


def _rest_residual(run: Run) -> float:
    """Largest vertex displacement of U φ(0), metres."""
    decoder = run.model.decoder
    u = run.basis_of("latent").displacement(decoder(np.zeros(decoder.r)))
    return float(np.linalg.norm(u, axis=1).max())


def _cubature(run: Run, space: str) -> schema.RuleNumbers | None:
    stored = run.cubature.get(space)
    if stored is None:
        return None
    seconds = run.header("cubature").notes.get(f"{space}_seconds")
    return schema.RuleNumbers(
        points=len(stored.best.points),
        relative_error=_force_errors(stored.best),
        virtual=None if stored.virtual is None else _virtual(stored.virtual.rule),
        stepped=points(run, space),
        seconds=None if seconds is None else _finite(float(seconds)),
    )


def _virtual(rule: CubatureRule) -> schema.VirtualRule:
    return schema.VirtualRule(points=len(rule.points), relative_error=_force_errors(rule))


def _force_errors(rule: CubatureRule) -> schema.ForceErrors:
    return schema.ForceErrors(fitted=_finite(rule.training_error), kept_back=_finite(rule.heldout_error))


def _motion_run(run: Run, motion: str, trajectory: Trajectory) -> schema.MotionRun:
    """Times and counts of the steps that were made, and the error over the whole motion."""
    made = np.isfinite(trajectory.seconds)
    milliseconds = MS_PER_S * trajectory.seconds[made]
    some = len(milliseconds) > 0
    return schema.MotionRun(
        motion=motion,
        role=cast(Role, run.motions[motion].role),
        frames=int(made.sum()),
        median_step_ms=_finite(np.median(milliseconds)) if some else None,
        p95_step_ms=_finite(np.percentile(milliseconds, 95)) if some else None,
        p99_step_ms=_finite(np.percentile(milliseconds, 99)) if some else None,
        iterations=_finite(trajectory.iterations[made].mean()) if some else None,
        evaluations=_finite(trajectory.evaluations[made].mean()) if some else None,
        online_error=_online_error(trajectory),
        novelty=_novelty(run, trajectory),
        diverged=trajectory.diverged,
    )


def _online_error(trajectory: Trajectory) -> schema.OnlineError | None:
    """Mean vertex distance to the full space over its mean displacement, and plain; infinite means None."""
    mean, largest = trajectory.mean_error, trajectory.max_error
    if mean is None or largest is None or len(mean) == 0:
        return None
    return schema.OnlineError(
        relative=_finite(trajectory.relative_error),
        windowed=_finite(trajectory.windowed_error),
        max_mm=_millimetres(largest.max()),
        mean_mm=_millimetres(mean.mean()),
    )


def _novelty(run: Run, trajectory: Trajectory) -> schema.NoveltyNumbers | None:
    """The score over the motion, the share of frames above the threshold, and how well it ranks the true error."""
    if trajectory.novelty is None or run.model.novelty is None:
        return None
    scores = trajectory.novelty[np.isfinite(trajectory.novelty)]
    if len(scores) == 0:
        return None
    threshold = run.model.novelty.threshold
    return schema.NoveltyNumbers(
        median=_finite(np.median(scores)),
        threshold=_finite(threshold),
        share_above=_finite((scores > threshold).mean()),
        rank_correlation=rank_correlation(trajectory.novelty, trajectory),
        rank_correlation_remembered=rank_correlation(remembered(trajectory.novelty, run.scene.time_step), trajectory),
        rank_correlation_time=rank_correlation(np.arange(len(trajectory.novelty), dtype=np.float64), trajectory),
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


def _frontier(run: Run) -> list[schema.FrontierRun]:
    """Every reduced space on every motion that it ran."""
    return [
        schema.FrontierRun(
            space=space,
            dimension=dimension(run, space),
            points=points(run, space),
            motion=motion,
            role=cast(Role, run.motions[motion].role),
            median_step_ms=_finite(MS_PER_S * float(np.nanmedian(trajectory.seconds))),
            online_error=None if trajectory.diverged else _finite(trajectory.relative_error),
            windowed_error=_finite(trajectory.windowed_error),
        )
        for space in spaces(run)
        for motion, trajectory in runs(run, space).items()
    ]


def _speedups(run: Run) -> schema.Speedups:
    role, found = judged(run, ("test", "validation", "train"))
    latent, equal, best = equal_error(found)
    beside = best if equal is None else equal
    return schema.Speedups(
        latent_over_linear_equal_error=None if latent is None or equal is None else equal.seconds / latent.seconds,
        judged_on=cast(Role, role) if found else None,
        latent_error=None if latent is None else _finite(latent.error),
        linear_space=None if beside is None else beside.space,
        linear_error=None if beside is None else _finite(beside.error),
        latent_over_linear_kp=_speedup(run, "linear"),
        latent_over_full=_speedup(run, "full"),
        chosen_over_full=_speedup(run, "full", run.chosen),
    )


def _speedup(run: Run, slower: str, faster: str = "latent") -> float | None:
    """Median step of the slower space over that of the faster one, over the same frames of the motions that both ran.

    A motion in which either diverged is left out: its steps are not of the same work.
    """
    ours, theirs = runs(run, faster), runs(run, slower)
    fast, slow = [], []
    for name, mine in ours.items():
        if name not in theirs or mine.diverged or theirs[name].diverged:
            continue
        seconds = theirs[name].seconds
        frames = stretch(run.motions[name].motion, len(seconds))  # of the full space a stretch was run
        fast.append(mine.seconds[frames.start : frames.stop])
        slow.append(seconds)
    if not fast:
        return None
    return _finite(float(np.median(np.concatenate(slow)) / np.median(np.concatenate(fast))))


def _inputs(run: Run) -> dict[str, str]:
    """The hash of every artefact; of tests.h5 where there is one."""
    return {kind: run.hash(kind) for kind in WRITTEN_BY if run.path(kind).is_file()}


def _statement(run: Run) -> schema.Statement | None:
    """Of the fresh motions, where there were some."""
    options = SimulateOptions.of_dump(run.header("simulation").settings).statement
    errors = run.fresh_errors
    if options is None or not errors:
        return None
    bounds = {space: bound(errors[space], options.quantile, options.confidence) for space in REDUCED}
    found, what, notes = bounds["latent"], about(options), run.header("simulation").notes
    before, lost = bool(notes.get(BEFORE, 0)), int(notes.get(LEFT_OUT, 0))
    return schema.Statement(
        sentence=sentence(found, what, before, lost, "" if run.chosen == "latent" else "latent"),
        about=what,
        motions=found.motions,
        quantile=found.quantile,
        confidence=found.confidence,
        **{
            space: schema.StatementBound(
                error=_finite(bounds[space].error),
                median=_finite(np.median(errors[space])),
                lost=int(np.isinf(errors[space]).sum()),
            )
            for space in REDUCED
        },
    )


def _stages(run: Run, own_cost: Mapping[str, float]) -> dict[str, schema.StageCost]:
    """Seconds and memory of each stage as its artefact's header has them, and the report's own."""
    notes = {STAGE_OF[kind]: run.header(kind).notes for kind in STAGE_OF} | {"report": own_cost}
    keys = tuple(schema.StageCost.model_fields)
    return {
        stage: schema.StageCost(**{key: _finite(float(values[key])) if key in values else None for key in keys})
        for stage, values in notes.items()
    }
