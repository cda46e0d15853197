"""The figures of a finished run."""

from __future__ import annotations

import numpy as np

from ldsim.report.figure import MARKERS, Axis, Figure, Guide, Series, curve
from ldsim.report.frontier import MS_PER_S, frontier_figure
from ldsim.report.numbers import pooled_seconds, rank_correlation
from ldsim.report.runs import dimensions, reduced_runs, runs
from ldsim.report.schema import MM_PER_M
from ldsim.report.wording import plain_number
from ldsim.run import REDUCED, SPACES, Run
from ldsim.space.novelty import remembered

VERTEX_DISTANCE = "mean vertex distance, mm"


def draw_figures(run: Run, cubature_tolerance: float) -> dict[str, Figure]:
    """Name → every figure that the run has data for; names begin with that of their place in the page."""
    figures = {
        "error_against_k": error_against_k(run),
        "singular_values": singular_values(run),
        "training": training_history(run),
        "cubature": cubature_error(run, cubature_tolerance),
        "step_times": step_times(run),
        "frontier": frontier_figure(run),
        **{f"online_error_{motion}": online_error(run, motion) for motion in run.motions},
        **{f"novelty_{motion}": novelty(run, motion) for motion in runs(run, "latent")},
    }
    return {name: figure for name, figure in figures.items() if figure is not None and figure.shows_something}


def error_against_k(run: Run) -> Figure:
    """Largest and mean error of PCA against the number of its modes, and what the autoencoder reaches."""
    stored = run.pca
    errors = {
        "training": (stored.max_error, stored.mean_error),
        "validation": (stored.validation_max_error, stored.validation_mean_error),
    }
    series = [
        curve(f"{which}, {role}", colour, np.arange(len(metres)), MM_PER_M * metres, marker=marker,
              dashed=role == "validation")
        for role, both in errors.items()
        for which, colour, marker, metres in zip(
            ("max", "mean"), ("linear", "second"), ("triangle", "circle"), both, strict=True
        )
        if metres is not None
    ]  # fmt: skip
    kind = "condensed" if run.model.condensed else "autoencoder"
    reached = [
        Guide(at, f"{kind} {which} {plain_number(at)} mm", colour="latent")
        for which, at in zip(("max", "mean"), (MM_PER_M * run.model.errors[0]).tolist(), strict=True)
        if at > 0
    ]
    return Figure(
        "Reconstruction error of PCA against its number of modes, beside the latent space’s",
        Axis("number of PCA modes"),
        Axis("vertex distance, mm", log=True),
        tuple(series),
        guides=(*reached, *_marks(run)),
        height=3.5,
    )


def singular_values(run: Run) -> Figure:
    """Singular values relative to the first: how fast the motions' variety fades."""
    values = run.pca.singular_values
    shown = np.unique(np.geomspace(1, len(values), 600).round().astype(int))
    return Figure(
        "Singular values of the snapshots, relative to the first",
        Axis("mode", log=True),
        Axis("singular value / first", log=True),
        (curve("singular value / first", "linear", shown, values[shown - 1] / values[0]),),
        guides=_marks(run),
    )


def training_history(run: Run) -> Figure:
    """Loss against epochs; of a condensed space what its fit came to, each time it was judged."""
    loss = run.model.loss
    epochs = np.arange(1, len(loss) + 1)
    if run.model.condensed:
        return Figure(
            "The fit of the condensed space: its loss, and the error of V_eff's force on poses kept back",
            Axis("share of the steps, %"),
            Axis("loss; relative force error", log=True),
            (
                curve("loss of the fit", "latent", 100 * epochs / len(loss), loss[:, 0]),
                curve("force, poses kept back", "second", 100 * epochs / len(loss), loss[:, 1], dashed=True),
            ),
        )
    return Figure(
        "Training and validation loss against epochs",
        Axis("epoch"),
        Axis("loss", log=True),
        (
            curve("training", "latent", epochs, loss[:, 0]),
            curve("validation", "second", epochs, loss[:, 1], dashed=True),
        ),
    )


def cubature_error(run: Run, tolerance: float) -> Figure:
    """Relative error of cubature against its number of points, for each space, and the tolerance asked for."""
    series = []
    for space in REDUCED:
        stored = run.cubature[space]
        points = [len(rule.points) for rule in stored.rules]
        fitted = [rule.training_error for rule in stored.rules]
        kept_back = [rule.heldout_error for rule in stored.rules]
        series += [
            curve(f"{space}, fitted poses", space, points, fitted, marker=MARKERS[space]),
            curve(f"{space}, kept back", space, points, kept_back, marker=MARKERS[space], dashed=True),
        ]
    return Figure(
        "Relative force error against the number of cubature points",
        Axis("cubature points", log=True),
        Axis("relative force error", log=True),
        tuple(one for one in series if one.x),
        guides=(Guide(tolerance, f"tolerance {plain_number(tolerance)}", at_start=True),),
    )


def step_times(run: Run) -> Figure | None:
    """The time of a step in each space: its median, and a hollow mark at the 95th percentile."""
    seconds = {space: times for space in SPACES if len(times := pooled_seconds(run, space))}
    series = []
    for row, (space, times) in enumerate(seconds.items()):
        median, slow = (float(MS_PER_S * np.percentile(times, share)) for share in (50, 95))
        series += [
            Series("", "ink", (median, slow), (row, row), "link"),
            Series("median", space, (median,), (row,), "marks", MARKERS[space], labels=(f"{median:.3g}",)),
            Series("95th percentile", space, (slow,), (row,), "marks", MARKERS[space], dashed=True),
        ]
    if not series:
        return None
    return Figure(
        "Time of one step in each space, milliseconds",
        Axis("time of one step, ms", log=True, margin=0.12),
        Axis(names=tuple(seconds)),
        tuple(series),
        height=1.3 + 0.42 * len(seconds),
    )


def online_error(run: Run, motion: str) -> Figure | None:
    """Mean vertex distance to the full-space run over a motion; a curve ends where its run diverged."""
    errors = {space: trajectory.mean_error for space, trajectory in reduced_runs(run, motion).items()}
    h, drags = run.scene.time_step, run.motions[motion].motion.drags
    # Frame i is the state at (i + 1) h, and a drag pulls from the beginning of its first step.
    series = [
        curve(space, space, h * np.arange(1, len(error) + 1), MM_PER_M * error, marker=MARKERS[space])
        for space, error in errors.items()
        if error is not None
    ]
    if not series:
        return None
    return Figure(
        f"Motion {motion}: mean vertex distance to the full-space run over time",
        Axis(f"motion {motion}: time, s", margin=0.01),
        Axis(VERTEX_DISTANCE, zero=True),
        tuple(series),
        shades={"grabbed": tuple((h * drag.start, h * drag.stop) for drag in drags)},
    )


def novelty(run: Run, motion: str) -> Figure | None:
    """The novelty score of each frame of a latent run, and its memory, beside the true error."""
    trajectory, score = runs(run, "latent")[motion], run.model.novelty
    if score is None or trajectory.novelty is None or trajectory.mean_error is None:
        return None
    seconds = run.scene.time_step * np.arange(1, len(trajectory.novelty) + 1)
    memory = remembered(trajectory.novelty, run.scene.time_step)
    correlation = rank_correlation(memory, trajectory)
    clock = rank_correlation(np.arange(len(memory), dtype=np.float64), trajectory)
    told = ""
    if correlation is not None and clock is not None:
        told = f" (rank correlation: memory {correlation:.2f}, time alone {clock:.2f})"
    return Figure(
        f"Motion {motion}: novelty score and true error over time",
        Axis(f"motion {motion}: time, s{told}", margin=0.01),
        Axis(VERTEX_DISTANCE, zero=True),
        (
            curve("true error", "latent", seconds, MM_PER_M * trajectory.mean_error),
            curve("novelty score", "second", seconds, trajectory.novelty, dashed=True, faint=True, right=True),
            curve("its memory", "second", seconds, memory, right=True),
        ),
        right=Axis("distance to the training codes", zero=True),
        guides=(Guide(score.threshold, f"warned of above {plain_number(score.threshold)}", "right"),),
    )


def _marks(run: Run) -> tuple[Guide, ...]:
    """An upright line at each of r, kp and k; those that coincide share one."""
    marks = dimensions(run)
    names = {count: " = ".join(name for name, value in marks.items() if value == count) for count in marks.values()}
    return tuple(Guide(count, f"{names[count]} = {count}", "x") for count in sorted(names))
