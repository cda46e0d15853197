"""The frontier of step.py: its numbers, its ratios and its picture."""

from __future__ import annotations

from typing import NamedTuple

from ldsim.report.svg import PALETTE, legend, log_scale, new_axes, to_svg
from reproduction.harness import Row, row


class Point(NamedTuple):
    """One space on one motion: dimension, outer dimension k, cubature points, stop rule in N, and what was seen."""

    space: str
    motion: str
    dimension: int
    k: int
    points: int
    stop: float
    minimiser: str
    median_ms: float
    p99_ms: float
    evaluations: float
    online_error: float
    windowed: float


def ratios(model: str, table: list[Point], kp: int) -> list[Row]:
    """Linear over latent step, both with the same stop rule: at kp, best sets; and the fastest linear space with an
    online error no larger, for the run's own latent space and for the latent point where that ratio is largest."""
    found: list[Row] = []
    for motion, stop in dict.fromkeys((point.motion, point.stop) for point in table):
        own = [point for point in table if (point.motion, point.stop) == (motion, stop)]
        latent = [point for point in own if point.space == "latent"]
        linear = [point for point in own if point.space == "linear"]
        label = f"linear over latent step, {motion}, stop {stop:g} N, "
        at_kp = next((point for point in linear if point.dimension == kp), None)
        if at_kp is not None:
            found.append(row(model, f"{label}PCA-{kp} (kp)", at_kp.median_ms / latent[0].median_ms, goal=">= 5"))
        equal = [(point, _equal(point, linear)) for point in latent]
        largest = max(equal, key=lambda pair: 0.0 if pair[1] is None else pair[1].median_ms / pair[0].median_ms)
        for name, (point, other) in (("", equal[0]), ("largest, ", largest)):
            value = None if other is None else other.median_ms / point.median_ms
            linear_side = "no PCA" if other is None else f"PCA-{other.dimension} with {other.points} points"
            sides = f"{name}{linear_side} against r {point.dimension}, k {point.k}, {point.points} points"
            found.append(row(model, f"{label}equal online error: {sides}", value, goal=">= 10"))
    return found


def _equal(latent: Point, linear: list[Point]) -> Point | None:
    """The fastest linear space whose online error is no larger."""
    good = [point for point in linear if point.online_error <= latent.online_error]
    return min(good, key=lambda point: point.median_ms) if good else None


def rows(model: str, table: list[Point]) -> list[Row]:
    """All that was measured."""
    found: list[Row] = []
    for p in table:
        label = f"{p.space} {p.dimension}, k {p.k}, {p.points} points, stop {p.stop:g} N, {p.motion}"
        found += [
            row(model, f"median step, {label}", p.median_ms, "ms"),
            row(model, f"99th percentile, {label}", p.p99_ms, "ms"),
            row(model, f"evaluations a step, {label}", p.evaluations),
            row(model, f"online error, {label}", p.online_error),
            row(model, f"windowed error, {label}", p.windowed),
        ]
    return found


def picture(model: str, motion: str, table: list[Point]) -> str:
    """Online error against median step, every space and set measured, the frontier of each kind as a line."""
    figure, ax = new_axes("median step, ms; numbers: dimension, points", f"online error on {motion}, %", height=3.6)
    for kind, colour in (("latent", PALETTE["latent"]), ("linear", PALETTE["linear"])):
        own = sorted((p.median_ms, 100 * p.online_error, p) for p in table if p.space == kind and p.motion == motion)
        front = [entry for i, entry in enumerate(own) if all(entry[1] < other[1] for other in own[:i])]
        behind = [entry for entry in own if entry not in front]
        ax.plot([t for t, _, _ in behind], [e for _, e, _ in behind], "o", color=colour, markersize=3, alpha=0.4)
        ax.plot([t for t, _, _ in front], [e for _, e, _ in front], "o-", color=colour, label=kind, markersize=4)
        for t, e, point in front:
            place = (-4, -9) if kind == "latent" else (4, 3)
            side = "right" if kind == "latent" else "left"
            label = f"{point.dimension}, {point.points}"
            ax.annotate(label, (t, e), place, textcoords="offset points", fontsize=7, color=colour, ha=side)
    log_scale(ax, "y")
    legend(ax)
    return to_svg(figure, f"Online error on {motion} of {model} against the median time of a step, latent and linear")
