"""The figures of a comparison: records of runs in, SVG text out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes

from ldsim.evaluation.plotting import INK, SPACE_COLOURS, legend, log_scale, new_axes, to_svg

# Shape tells the spaces apart where colour does not; a held-out motion is filled, a training motion hollow.
MARKERS = {"full": "D", "linear": "s", "latent": "o"}
ROLE_NAMES = {"heldout": "held-out", "train": "training"}
Mark = tuple[str, str, Callable[[Mapping[str, Any]], float | None]]


def figures(records: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Name → SVG of the figures that there is something to draw in.

    Args:
        records: of `compare_runs.record`.
    """
    drawn = {
        "error_against_time": _error_against_time(records),
        "online_errors": _rows(
            records,
            "online error, % of the mean displacement (filled: held-out)",
            [(space, role, _error(role, space)) for role in ROLE_NAMES for space in ("linear", "latent")],
            "Online error of each run's linear and latent space on training and held-out motions",
        ),
        "step_times": _rows(
            records,
            "median step, ms",
            [(space, "heldout", _step(space)) for space in SPACE_COLOURS],
            "Median time of a step of each run in the full, the linear and the latent space",
        ),
    }
    return {name: svg for name, svg in drawn.items() if svg}


def _step(space: str) -> Callable[[Mapping[str, Any]], float | None]:
    def read(record: Mapping[str, Any]) -> float | None:
        value: float | None = record["step_ms"][space]
        return value

    return read


def _error(role: str, space: str) -> Callable[[Mapping[str, Any]], float | None]:
    """The online error in per cent."""

    def read(record: Mapping[str, Any]) -> float | None:
        relative = (record["online"][role][space] or {}).get("relative")
        return None if relative is None else 100 * float(relative)

    return read


def _mark(ax: Axes, x: float, y: float, space: str, role: str, label: str | None) -> None:
    colour = SPACE_COLOURS[space]
    face = colour if role == "heldout" else "none"
    ax.plot([x], [y], MARKERS[space], color=colour, mfc=face, ms=6.5, mew=1.5, ls="none", label=label)


def _error_against_time(records: Sequence[Mapping[str, Any]]) -> str:
    """Online error against step time, a line from each run's linear to its latent space; empty where nothing is."""
    figure, ax = new_axes("median step, ms", "online error, % (filled: held-out)", height=3.5)
    named = set()
    for record in records:
        for role in ROLE_NAMES:
            points = {
                space: (step, error)
                for space in ("linear", "latent")
                if (step := _step(space)(record)) and (error := _error(role, space)(record))
            }
            ax.plot(
                [step for step, _ in points.values()], [e for _, e in points.values()], color=INK, lw=0.7, alpha=0.35
            )
            for space, (step, error) in points.items():
                _mark(ax, step, error, space, role, None if space in named else space)
                named.add(space)
            if "latent" in points:
                name = f"{record['name']}, {ROLE_NAMES[role]}"
                ax.annotate(name, points["latent"], xytext=(6, 4), textcoords="offset points", color=INK, fontsize=8)
    if not named:
        return ""
    ax.margins(x=0.25, y=0.15)
    log_scale(ax, "x")
    log_scale(ax, "y")
    legend(ax)
    return to_svg(figure, "Online error against the time of a step, linear and latent space of each run")


def _rows(records: Sequence[Mapping[str, Any]], axis: str, marks: Sequence[Mark], label: str) -> str:
    """One row a run, its values as marks on a logarithmic axis; empty where there are none."""
    figure, ax = new_axes(axis, "", height=1.3 + 0.42 * len(records))
    named = set()
    for row, record in enumerate(reversed(records)):
        for space, role, read in marks:
            value = read(record)
            if value:
                _mark(ax, value, row, space, role, None if space in named else space)
                named.add(space)
    if not named:
        return ""
    ax.set_yticks(range(len(records)), [record["name"] for record in reversed(records)])
    ax.tick_params(axis="y", length=0, labelsize=10)
    ax.set_ylim(-0.6, len(records) - 0.4)
    ax.margins(x=0.1)
    log_scale(ax, "x")
    legend(ax)
    return to_svg(figure, label)
