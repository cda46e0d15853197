"""The figures of a comparison: records of runs in, SVG text out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldsim.report.compare_runs import REDUCED
from ldsim.report.plotting import INK, SPACE_COLOURS, SPACE_MARKERS, legend, log_scale, new_axes, to_svg
from ldsim.report.report_schema import ROLES, SPACES
from ldsim.report.sections import ROLE_NAMES

Record = Mapping[str, Any]
# Shape tells the spaces apart where colour does not; a held-out motion is filled, a training motion hollow.
MARKERS = {"full": "D"} | SPACE_MARKERS


def figures(records: Sequence[Record]) -> dict[str, str]:
    """Name → SVG of the figures that there is something to draw in.

    Args:
        records: of `compare_runs.record`.
    """
    drawn = {
        "error_against_time": _error_against_time(records),
        "online_errors": _online_errors(records),
        "step_times": _step_times(records),
    }
    return {name: svg for name, svg in drawn.items() if svg}


def _error(record: Record, role: str, space: str) -> float | None:
    """The online error in per cent; None where it is not known, or 0, which a logarithmic axis has no place for."""
    relative = (record["online"][role][space] or {}).get("relative")
    return 100 * float(relative) if relative else None


def _marks(ax: Axes, points: Sequence[tuple[float, float]], space: str, label: str, filled: bool = True) -> bool:
    """Draw the points of one space; whether there are any."""
    if points:
        # A line without width: the page's script reads the values from its path.
        colour = SPACE_COLOURS[space]
        x, y = zip(*points, strict=True)
        face = colour if filled else "none"
        ax.plot(x, y, marker=MARKERS[space], color=colour, mfc=face, ms=6.5, mew=1.5, lw=0, label=label)
    return bool(points)


def _error_against_time(records: Sequence[Record]) -> str:
    """Online error against step time, a line from each run's linear to its latent space; empty where nothing is."""
    figure, ax = new_axes("median step, ms", "online error, %", height=3.7)
    found = {
        (role, space, record["name"]): (step, error)
        for role in reversed(ROLES)
        for space in REDUCED
        for record in records
        if (step := record["step_ms"][space]) and (error := _error(record, role, space))
    }
    if not found:
        return ""
    for role in reversed(ROLES):
        for space in REDUCED:
            points = [point for key, point in found.items() if key[:2] == (role, space)]
            _marks(ax, points, space, f"{space}, {ROLE_NAMES[role]}", role == "heldout")
    for (role, space, name), point in found.items():
        other = found.get((role, "linear", name))
        if space == "latent":
            ax.annotate(name, point, xytext=(6, 4), textcoords="offset points", color=INK, fontsize=8)
            if other is not None:
                ax.plot([point[0], other[0]], [point[1], other[1]], color=INK, lw=0.7, alpha=0.35, zorder=1)
    ax.margins(x=0.2, y=0.15)
    log_scale(ax, "x")
    log_scale(ax, "y")
    legend(ax)
    return to_svg(figure, "Online error against the time of a step, linear and latent space of each run")


def _online_errors(records: Sequence[Record]) -> str:
    """One row a run, its online errors in both reduced spaces and roles."""
    figure, ax = new_axes("online error, % of the mean displacement", "", height=1.5 + 0.42 * len(records))
    drawn = [
        _marks(
            ax,
            [(error, row) for row, record in enumerate(records) if (error := _error(record, role, space))],
            *(space, f"{space}, {ROLE_NAMES[role]}", role == "heldout"),
        )
        for role in reversed(ROLES)
        for space in REDUCED
    ]
    label = "Online errors of each run on training and held-out motions"
    return _rows(figure, ax, records, label) if any(drawn) else ""


def _step_times(records: Sequence[Record]) -> str:
    """One row a run, its step times in the three spaces."""
    figure, ax = new_axes("median step, ms", "", height=1.3 + 0.42 * len(records))
    drawn = [
        _marks(ax, [(step, i) for i, record in enumerate(records) if (step := record["step_ms"][space])], space, space)
        for space in SPACES
    ]
    label = "Time of a step of each run in the full, the linear and the latent space"
    return _rows(figure, ax, records, label) if any(drawn) else ""


def _rows(figure: Figure, ax: Axes, records: Sequence[Record], label: str) -> str:
    """The SVG of axes with one row a run, the first on top."""
    ax.set_yticks(range(len(records)), [record["name"] for record in records])
    ax.tick_params(axis="y", length=0, labelsize=10)
    ax.set_ylim(len(records) - 0.4, -0.6)
    ax.margins(x=0.1)
    log_scale(ax, "x")
    legend(ax)
    return to_svg(figure, label)
