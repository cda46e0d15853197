"""The figures of a report: arrays in, SVG text out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ldsim.report.errors import ErrorSummary
from ldsim.report.plotting import (
    DASHED,
    GREEN,
    INK,
    LATENT,
    LINEAR,
    MAX_POINTS,
    SPACE_COLOURS,
    SPACE_MARKERS,
    legend,
    log_scale,
    marked,
    new_axes,
    plain_number,
    thinned,
    to_svg,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ErrorCurve:
    """Reconstruction error against the number of PCA modes: largest and mean vertex distance, (K,) each, mm."""

    max_mm: Array
    mean_mm: Array


@dataclass(frozen=True, eq=False)
class CubatureCurve:
    """The ladder of cubature sets of one space.

    Attributes:
        space: "latent" or "linear".
        points: cubature points of each set, (L,).
        train, heldout: relative error of each set, (L,); `heldout` is None where it was not measured.
    """

    space: str
    points: Array
    train: Array
    heldout: Array | None = None


@dataclass(frozen=True)
class StepTime:
    """Time of one step: median and 95th percentile, milliseconds."""

    median_ms: float
    p95_ms: float


def error_against_k(
    modes: Array,
    train: ErrorCurve,
    heldout: ErrorCurve | None = None,
    marks: Mapping[str, int] | None = None,
    autoencoder: ErrorSummary | None = None,
) -> str:
    """Error of PCA against the number of its modes, and what the autoencoder reaches.

    Args:
        modes: numbers of modes, (K,).
        train, heldout: the errors at these numbers.
        marks: name → number of modes to point out, such as r, kp and k.
        autoencoder: its error on the training frames, drawn as two horizontal lines.
    """
    figure, ax = new_axes("number of PCA modes", "vertex distance, mm", height=3.5)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    for curve, name, dashes in ((train, "training", "-"), (heldout, "held-out", DASHED)):
        if curve is not None:
            drawn: dict[str, Any] = {"ls": dashes, "lw": 1.7, "mfc": None if dashes == "-" else "none", **marked(modes)}
            ax.plot(*thinned(modes, curve.max_mm), color=LINEAR, marker="^", label=f"max, {name}", **drawn)
            ax.plot(*thinned(modes, curve.mean_mm), color=GREEN, marker="o", label=f"mean, {name}", **drawn)
    if autoencoder is not None:
        for value, name in ((autoencoder.max_mm, "max"), (autoencoder.mean_mm, "mean")):
            label = "autoencoder, training" if name == "max" else None
            ax.axhline(value, color=LATENT, lw=1.2, alpha=0.85, label=label)
            _line_label(ax, value, f"autoencoder {name} {plain_number(value)} mm")
    log_scale(ax, "y")
    _mark_modes(ax, marks or {})
    legend(ax)
    return to_svg(figure, "Reconstruction error of PCA against its number of modes, beside the autoencoder's")


def singular_values(values: Array, marks: Mapping[str, int] | None = None) -> str:
    """Singular values (K,) relative to the first: how fast the motions' variety fades; `marks` as above."""
    figure, ax = new_axes("mode", "singular value / first")
    shown = np.unique(np.geomspace(1, len(values), MAX_POINTS).round().astype(int))
    ax.plot(shown, values[shown - 1] / values[0], color=LINEAR, lw=1.7)
    log_scale(ax, "x")
    log_scale(ax, "y")
    _mark_modes(ax, marks or {})
    return to_svg(figure, "Singular values of the snapshots, relative to the first")


def training_history(
    epochs: Array, training: Array, validation: Array | None = None, learning_rate: Array | None = None
) -> str:
    """Loss against epochs, (E,) each; the learning rate, where given, on an axis of its own to the right."""
    figure, ax = new_axes("epoch", "loss")
    ax.plot(*thinned(epochs, training), color=LATENT, lw=1.2, zorder=3, label="training")
    if validation is not None:
        ax.plot(*thinned(epochs, validation), color=GREEN, lw=1.2, ls=DASHED, label="validation")
    log_scale(ax, "y")
    if learning_rate is not None:
        rate = ax.twinx()
        rate.set_ylabel("learning rate", color=INK, fontsize=9.5)
        rate.tick_params(colors=INK, labelsize=9, length=0)
        rate.spines[:].set_visible(False)
        rate.plot(*thinned(epochs, learning_rate), color=INK, lw=1, ls=":", alpha=0.6, label="learning rate")
        ax.plot([], [], color=INK, lw=1, ls=":", alpha=0.6, label="learning rate (right)")
        log_scale(rate, "y")
    legend(ax)
    return to_svg(figure, "Training and validation loss against epochs")


def cubature_error(curves: Sequence[CubatureCurve], tolerance: float | None = None) -> str:
    """Relative error of cubature against its number of points, for each space, and the tolerance asked for."""
    figure, ax = new_axes("cubature points", "relative force error")
    for curve in curves:
        drawn: dict[str, Any] = {"color": SPACE_COLOURS[curve.space], "marker": SPACE_MARKERS[curve.space], "ms": 3}
        ax.plot(*thinned(curve.points, curve.train), lw=1.7, label=f"{curve.space}, training", **drawn)
        if curve.heldout is not None:
            label = f"{curve.space}, held-out"
            ax.plot(*thinned(curve.points, curve.heldout), lw=1.4, ls=DASHED, mfc="none", label=label, **drawn)
    if tolerance is not None:
        ax.axhline(tolerance, color=INK, lw=1, alpha=0.7)
        _line_label(ax, tolerance, f"tolerance {plain_number(tolerance)}", side="left")
    log_scale(ax, "x")
    log_scale(ax, "y")
    legend(ax)
    return to_svg(figure, "Relative force error against the number of cubature points")


def step_times(times: Mapping[str, StepTime]) -> str:
    """Bars of the step time of each space: the median, its value, and a whisker to the 95th percentile.

    Bars on a logarithmic axis start at a tenth of the smallest median, so compare their ends, not their lengths.
    """
    figure, ax = new_axes(
        "time of one step, ms (median; whisker to the 95th percentile)", "", height=1.1 + 0.42 * len(times)
    )
    names = list(times)[::-1]
    left = min(time.median_ms for time in times.values()) / 10
    for row, name in enumerate(names):
        time = times[name]
        ax.barh(row, time.median_ms - left, left=left, height=0.62, color=SPACE_COLOURS[name])
        ax.plot([time.median_ms, time.p95_ms], [row, row], color=INK, lw=1.2, marker="|", markevery=[1], ms=8)
        for value, which in ((time.median_ms, "median"), (time.p95_ms, "95th percentile")):
            ax.plot([value], [row], lw=0, label=f"{name}, {which}")
        ax.annotate(
            f"{time.median_ms:.3g}", (max(time.p95_ms, time.median_ms), row), xytext=(7, 0),
            textcoords="offset points", va="center", color=INK, fontsize=10, fontweight="bold",
        )  # fmt: skip
    ax.set_yticks(range(len(names)), names)
    ax.tick_params(axis="y", length=0, labelsize=10.5)
    ax.grid(False, axis="y")
    ax.set_xlim(left, 3 * max(time.p95_ms for time in times.values()))
    log_scale(ax, "x")
    return to_svg(figure, "Time of one step in each space, milliseconds")


def online_error_over_time(
    seconds: Array, mean_mm: Mapping[str, Array], grabs: Sequence[tuple[float, float]] = (), motion: str = ""
) -> str:
    """Mean vertex distance to the full-space run over a motion.

    Args:
        seconds: time of each frame, (N,).
        mean_mm: space → mean vertex distance of each frame, (N,), millimetres; a curve ends where it diverged.
        grabs: begin and end of each grab, seconds; shaded.
        motion: its name, which tells the figure from those of other motions.
    """
    where = f"motion {motion}: " if motion else ""
    figure, ax = new_axes(f"{where}time, s", "mean vertex distance, mm")
    for i, (begin, end) in enumerate(grabs):
        ax.axvspan(begin, end, color=INK, alpha=0.08, lw=0, label="grabbed" if i == 0 else None)
    for space, curve in mean_mm.items():
        marker, colour = SPACE_MARKERS[space], SPACE_COLOURS[space]
        ax.plot(*thinned(seconds, curve), color=colour, marker=marker, lw=1.5, label=space, **marked(seconds))
    ax.set_ylim(bottom=0)
    ax.margins(x=0.01)
    legend(ax)
    return to_svg(figure, f"{where.capitalize()}mean vertex distance to the full-space run over time")


def trust_over_time(
    seconds: Array,
    scores: tuple[Array, Array],
    error_mm: Array,
    threshold: float,
    correlation: float | None,
    motion: str,
) -> str:
    """The trust score of each frame, and its memory, beside the true error.

    Args:
        seconds, error_mm: of each frame, (N,).
        scores: the score and its memory, (N,) each.
        threshold: score from which on a frame is distrusted.
        correlation: Spearman's, of memory and error.
    """
    told = "" if correlation is None else f" (rank correlation of memory and error {correlation:.2f})"
    figure, ax = new_axes(f"motion {motion}: time, s{told}", "mean vertex distance, mm")
    ax.plot(*thinned(seconds, error_mm), color=LATENT, lw=1.5, label="true error")
    right = ax.twinx()
    right.set_ylabel("distance to the training codes", color=INK, fontsize=9.5)
    right.tick_params(colors=INK, labelsize=9, length=0)
    right.spines[:].set_visible(False)
    score, memory = scores
    right.plot(*thinned(seconds, score), color=GREEN, lw=0.8, ls=DASHED, alpha=0.6, label="trust score")
    right.plot(*thinned(seconds, memory), color=GREEN, lw=1.8, label="its memory")
    right.axhline(threshold, color=INK, lw=1, ls=":", alpha=0.7)
    _line_label(right, threshold, f"distrusted above {plain_number(threshold)}")
    ax.plot([], [], color=GREEN, lw=0.8, ls=DASHED, label="trust score (right)")
    ax.plot([], [], color=GREEN, lw=1.8, label="its memory (right)")
    for axis in (ax, right):
        axis.set_ylim(bottom=0)
    ax.margins(x=0.01)
    legend(ax)
    return to_svg(figure, f"Motion {motion}: trust score and true error over time")


def _line_label(ax: Axes, y: float, text: str, side: Literal["left", "right"] = "right") -> None:
    """A small text on a horizontal line, at one of its ends."""
    at, inwards = (0, 3) if side == "left" else (1, -3)
    ax.annotate(
        text, (at, y), xycoords=("axes fraction", "data"), xytext=(inwards, 2), textcoords="offset points",
        ha=side, va="bottom", color=INK, fontsize=8,
    )  # fmt: skip


def _mark_modes(ax: Axes, marks: Mapping[str, int]) -> None:
    """A thin upright line at each marked number of modes with its name at the foot; marks that coincide share one."""
    for count in sorted(set(marks.values())):
        names = " = ".join(name for name, value in marks.items() if value == count)
        ax.axvline(count, color=INK, lw=0.8, ls=(0, (1, 2)), alpha=0.7)
        ax.annotate(
            f"{names} = {count}", (count, 0), xycoords=("data", "axes fraction"), xytext=(3, 3),
            textcoords="offset points", ha="left", va="bottom", color=INK, fontsize=8.5, rotation=90,
        )  # fmt: skip
