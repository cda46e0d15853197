"""Figures as SVG files: small, with text as text, readable on light and on dark pages.

Matplotlib draws; afterwards the ink's stand-in colour becomes `currentColor`, which a style inside the SVG sets for
light and for dark, and identifiers are made unlike those of other figures in one page.
"""

from __future__ import annotations

import hashlib
import re
from html import escape
from io import StringIO

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from ldsim.report.figure import Axis, Figure, Guide, Series
from ldsim.report.wording import plain_number
from ldsim.web import page

INK = "#010203"
DASHED = (0, (4, 2))
SHAPES = {"": "", "circle": "o", "square": "s", "diamond": "D", "triangle": "^"}

_STYLE = (
    "<style>.ldsim-figure{color:#23282f;font-variant-numeric:tabular-nums;"
    "font-family:system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif}"
    ".ldsim-figure *{stroke-linejoin:round;stroke-linecap:butt}"
    "@media (prefers-color-scheme:dark){.ldsim-figure{color:#dfe3e8}}"
    "@media print{.ldsim-figure{color:#23282f}}</style>"
)


def _palette() -> dict[str, str]:
    """The colours of the pages on a light ground."""
    text = page("palette.css")
    return dict(re.findall(r"--([\w-]+): (#\w+);", text[: text.index("@media")]))


# Name → colour; ink is a stand-in that follows the page.
PALETTE = _palette() | {"ink": INK}


def drawn(figure: Figure) -> str:
    """The figure as an SVG element without XML prolog, to stand alone or inside a page."""
    canvas, ax = new_axes(figure.x.label, figure.y.label, figure.height)
    sides = {False: ax, True: ax}
    if figure.right is not None:
        sides[True] = right_axis(ax, figure.right.label)
    for name, stretches in (figure.shades or {}).items():
        for i, (begin, end) in enumerate(stretches):
            ax.axvspan(begin, end, color=INK, alpha=0.08, lw=0, label="" if i else name)
    for series in figure.series:
        _draw_series(sides[series.right], series)
    ax.margins(x=figure.x.margin, y=figure.y.margin)
    for side, axis in ((ax, figure.y), (sides[True], figure.right)):
        if axis is not None:
            _scale(side, "y", axis)
    _scale(ax, "x", figure.x)
    for guide in figure.guides:
        _draw_guide(sides[guide.axis == "right"], guide)
    legend(*dict.fromkeys(sides.values()))
    return to_svg(canvas, figure.title)


def _draw_series(ax: Axes, series: Series) -> None:
    colour = PALETTE[series.colour]
    if series.kind == "link":
        ax.plot(series.x, series.y, color=INK, lw=0.7, alpha=0.35, zorder=1)
        return
    line = 0.8 if series.faint else 1.7
    many = max(len(series.x) // 8, 1) if series.kind == "line" else 1
    ax.plot(
        series.x, series.y, color=colour, alpha=0.6 if series.faint else 1, label=series.name,
        lw=line if series.kind == "line" else 0, ls=DASHED if series.dashed else "-", marker=SHAPES[series.marker],
        mfc="none" if series.dashed else colour, ms=4 if series.kind == "line" else 6.5, markevery=many,
    )  # fmt: skip
    for x, y, text in zip(series.x, series.y, series.labels, strict=False):
        ax.annotate(text, (x, y), xytext=(7, 4), textcoords="offset points", color=INK, fontsize=8.5)


def _draw_guide(ax: Axes, guide: Guide) -> None:
    """A line across the axes with its words: upright lines have them at the top, level ones at an end."""
    colour = PALETTE[guide.colour]
    if guide.axis == "x":
        ax.axvline(guide.at, color=colour, lw=0.8, ls=(0, (1, 2)), alpha=0.7)
        place, anchor, shift = (guide.at, 1.0), ("data", "axes fraction"), (-3, -2)
    else:
        ax.axhline(guide.at, color=colour, lw=1, alpha=0.8)
        place, anchor, shift = (
            (float(not guide.at_start), guide.at),
            ("axes fraction", "data"),
            (3 if guide.at_start else -3, 2),
        )
    upright = guide.axis == "x"
    ax.annotate(
        guide.text, place, xycoords=anchor, xytext=shift, textcoords="offset points", color=INK, fontsize=8.5,
        ha="left" if guide.at_start else "right", va="top" if upright else "bottom", rotation=90 if upright else 0,
    )  # fmt: skip


def _scale(ax: Axes, which: str, axis: Axis) -> None:
    if axis.names:
        ax.set_yticks(range(len(axis.names)), axis.names)
        ax.tick_params(axis="y", length=0, labelsize=10)
        ax.set_ylim(len(axis.names) - 0.4, -0.6)
    elif axis.log:
        log_scale(ax, which)
    elif axis.zero:
        ax.set_ylim(bottom=0)
    elif which == "x":
        ax.xaxis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 5, 10]))


def new_axes(x_label: str, y_label: str, height: float = 2.9) -> tuple[Canvas, Axes]:
    """A figure of one axes with quiet spines, a faint grid, and room for a legend above it."""
    figure = Canvas(figsize=(5.2, height), layout="constrained")
    figure.patch.set_alpha(0.0)
    ax = figure.add_subplot()
    ax.patch.set_alpha(0.0)
    for side, spine in ax.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=INK, alpha=0.35, linewidth=0.8)
    ax.grid(True, color=INK, alpha=0.12, linewidth=0.6)
    ax.set_axisbelow(True)
    ax.tick_params(colors=INK, labelsize=9, length=3, width=0.6)
    ax.set_xlabel(x_label, color=INK, fontsize=9.5)
    ax.set_ylabel(y_label, color=INK, fontsize=9.5)
    return figure, ax


def right_axis(ax: Axes, label: str) -> Axes:
    """A second axes with the same x and its own y on the right, without a grid."""
    right = ax.twinx()
    right.set_ylabel(label, color=INK, fontsize=9.5)
    right.tick_params(colors=INK, labelsize=9, length=0)
    right.spines[:].set_visible(False)
    return right


def log_scale(ax: Axes, axis: str) -> None:
    """Make an axis ("x" or "y") logarithmic, with ticks written as plain numbers where these stay short."""
    ax.set(**{f"{axis}scale": "log"})
    which = ax.xaxis if axis == "x" else ax.yaxis
    low, high = sorted(ax.get_xlim() if axis == "x" else ax.get_ylim())
    decades = np.log10(high / low)
    subs = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0) if decades < 1 else (1.0, 2.0, 5.0) if decades < 2 else (1.0,)
    which.set_major_locator(LogLocator(subs=subs, numticks=12))
    which.set_minor_locator(NullLocator())
    which.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value)))


def legend(ax: Axes, right: Axes | None = None) -> None:
    """A legend in a row above the axes, so that it never covers a curve; what is read off on the right says so."""
    entries: dict[str, Artist] = {}
    for side, remark in ((ax, ""), (right, " (right)")):
        for handle, name in zip(*side.get_legend_handles_labels(), strict=True) if side else ():
            entries.setdefault(name + remark, handle)
    entries.pop("", None)
    if entries:
        ax.legend(
            list(entries.values()), list(entries), loc="lower left", bbox_to_anchor=(0, 1.0), frameon=False,
            ncols=len(entries) if len(entries) < 4 else 2, fontsize=9, labelcolor=INK, handlelength=1.8,
            columnspacing=1.4, borderaxespad=0.2,
        )  # fmt: skip


def to_svg(figure: Canvas, label: str) -> str:
    """What matplotlib drew as an SVG element.

    Args:
        label: what the figure shows, one sentence, for those who do not see it.
    """
    buffer = StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "ldsim"}):
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        FigureCanvasSVG(figure).print_svg(buffer, metadata=nothing)  # type: ignore[no-untyped-call]
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<style[^>]*>.*?</style>", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    text = re.sub(r'(id="|#)([mp][0-9a-f]{10})(?=[")])', rf"\1\2-{digest}", text)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"\d+\.\d{4,}", lambda match: f"{float(match[0]):.3f}", text)
    text = re.sub(r"font-family: [^;\"]*;? ?", "", text.replace(INK, "currentColor"))
    title = escape(label).replace("\\", r"\\")
    opening = (
        r'<svg class="ldsim-figure" viewBox="\1" role="img" xmlns="http://www.w3.org/2000/svg" '
        rf'xmlns:xlink="http://www.w3.org/1999/xlink"><title>{title}</title>{_STYLE}'
    )
    text = re.sub(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', opening, text, count=1)
    return re.sub(r"\n\s*", "\n", text)
