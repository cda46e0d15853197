"""What all figures share: colours, axes, thinning, and SVG that is small and reads on light and dark pages.

Matplotlib draws; afterwards the ink's stand-in colour becomes `currentColor`, which a style inside the SVG sets for
light and for dark, text stays text, and identifiers are made unlike those of other figures in one page. What the page's
script (web/plot.js) must know to read values and to zoom stands in attributes: `data-axes` on the figure, and on groups
the classes `ldsim-curve`, `ldsim-axis` and `ldsim-note`. The values themselves are read back from the drawn paths.
"""

from __future__ import annotations

import hashlib
import json
import re
from html import escape
from io import StringIO
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from ldsim.report.html import SUPERSCRIPTS

Array = NDArray[np.float64]

# Okabe and Ito's palette, its blue a little lighter: at least 3 : 1 on white and on near-black.
INK = "#010203"
LINEAR = "#1f83c4"
LATENT = "#d55e00"
FULL = "#7a828c"
# Curves differ by dashes or markers too, for those who see no difference of colours.
SPACE_MARKERS = {"linear": "s", "latent": "o"}
DASHED = (0, (4, 2))
SPACE_COLOURS = {"full": FULL, "linear": LINEAR, "latent": LATENT}
GREEN = "#00966c"

MAX_POINTS = 600

_STYLE = (
    "<style>.ldsim-figure{color:#23282f;font-variant-numeric:tabular-nums;"
    "font-family:system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif}"
    ".ldsim-figure *{stroke-linejoin:round;stroke-linecap:butt}"
    "@media (prefers-color-scheme:dark){.ldsim-figure{color:#dfe3e8}}"
    "@media print{.ldsim-figure{color:#23282f}}</style>"
)


def new_axes(x_label: str, y_label: str, height: float = 2.9) -> tuple[Figure, Axes]:
    """A figure of one axes with quiet spines, a faint grid, and room for a legend above it."""
    figure = Figure(figsize=(5.2, height), layout="constrained")
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


def log_scale(ax: Axes, axis: str) -> None:
    """Make an axis ("x" or "y") logarithmic, with ticks written as plain numbers where these stay short."""
    ax.set(**{f"{axis}scale": "log"})
    which = ax.xaxis if axis == "x" else ax.yaxis
    low, high = sorted(ax.get_xlim() if axis == "x" else ax.get_ylim())
    decades = np.log10(high / low)
    which.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2 else (1.0,), numticks=12))
    which.set_minor_locator(NullLocator())
    which.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value)))


def plain_number(value: float) -> str:
    """`value` as a short tick label: 0.05, 2, 1 000, and 10⁻⁶ beyond that."""
    if value == 0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}".replace(",", "\u2009")
    mantissa, exponent = f"{value:.0e}".split("e")
    power = "10" + str(int(exponent)).translate(SUPERSCRIPTS)
    return power if mantissa == "1" else f"{mantissa}·{power}"


def marked(x: Array) -> dict[str, Any]:
    """How markers sit on a curve over x (N,): small, and about eight."""
    return {"ms": 4, "markevery": max(min(len(x), MAX_POINTS) // 8, 1)}


def legend(ax: Axes) -> None:
    """A legend in a row above the axes, so that it never covers a curve."""
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        ax.legend(
            loc="lower left", bbox_to_anchor=(0, 1.0), ncols=len(labels) if len(labels) < 4 else 2, frameon=False,
            fontsize=9, labelcolor=INK, handlelength=1.8, columnspacing=1.4, borderaxespad=0.2,
        )  # fmt: skip


def thinned(x: Array, y: Array, limit: int = MAX_POINTS) -> tuple[Array, Array]:
    """At most `limit` points of the curve y(x), (N,) each, that keep its peaks.

    The curve is cut into limit/2 runs of equal length, and each gives its lowest and its highest point. Points that
    are not finite are left out.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if x.shape != y.shape or x.ndim != 1:
        raise ValueError(f"a curve has x of shape {x.shape} and y of shape {y.shape}; expected twice the same (N,)")
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if len(x) <= limit:
        return x, y
    runs = np.array_split(np.arange(len(x)), limit // 2)
    keep = np.unique([run[pick(y[run])] for run in runs for pick in (np.argmin, np.argmax)])
    return x[keep], y[keep]


def to_svg(figure: Figure, label: str) -> str:
    """The figure as an SVG element without XML prolog, to stand alone or inside a page.

    Args:
        label: what the figure shows, one sentence, for those who do not see it.
    """
    _name_parts(figure)
    buffer = StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "ldsim"}):
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        FigureCanvasSVG(figure).print_svg(buffer, metadata=nothing)  # type: ignore[no-untyped-call]
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<style[^>]*>.*?</style>", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r'<g id="ldsim-(\w+)\|(\d+)\|([^"]*)"', r'<g class="ldsim-\1" data-axes="\2" data-name="\3"', text)
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    text = re.sub(r'(id="|#)([mp][0-9a-f]{10})(?=[")])', rf"\1\2-{digest}", text)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"\d+\.\d{4,}", lambda match: f"{float(match[0]):.3f}", text)
    text = re.sub(r"font-family: [^;\"]*;? ?", "", text.replace(INK, "currentColor"))
    text = re.sub(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', _opening(label, _described_axes(figure)), text, count=1)
    return re.sub(r"\n\s*", "\n", text)


def _opening(label: str, axes: str) -> str:
    """The replacement pattern for the <svg> tag: scalable, labelled, styled."""
    name, told = (escape(text).replace("\\", r"\\") for text in (label, axes))
    return (
        rf'<svg class="ldsim-figure" data-axes="{told}" viewBox="\1" role="img" xmlns="http://www.w3.org/2000/svg" '
        rf'xmlns:xlink="http://www.w3.org/1999/xlink"><title>{name}</title>{_STYLE}'
    )


def _name_parts(figure: Figure) -> None:
    """Identifiers for the groups that the script must find: kind|axes|name."""
    for i, ax in enumerate(figure.axes):
        for line in ax.lines:
            label = str(line.get_label())
            if line.get_transform() == ax.transData and np.size(line.get_xydata()) and not label.startswith("_"):
                line.get_path().should_simplify = False
                line.set_gid(f"ldsim-curve|{i}|{label}")
        for axis, name in ((ax.xaxis, "x"), (ax.yaxis, "y")):
            axis.set_gid(f"ldsim-axis|{i}|{name}")
            axis.label.set_gid(f"ldsim-label|{i}|{name}")
        for note in ax.texts:
            if isinstance(note, Annotation):
                note.set_gid(f"ldsim-note|{i}|{json.dumps(_anchor(note))}")


def _anchor(note: Annotation) -> list[float | None]:
    """Where a note hangs, (x, y) in data coordinates; None along an axis with which it does not move."""
    coordinates = note.xycoords if isinstance(note.xycoords, tuple) else (note.xycoords, note.xycoords)
    return [float(at) if kind == "data" else None for at, kind in zip(note.xy, coordinates, strict=True)]


def _described_axes(figure: Figure) -> str:
    """JSON: of each axes its box (left, top, right, bottom) in the drawing's units; label, limits and scale of x and y.

    Both axes of a figure share the box; a scale without a label has nothing to read off.
    """
    width, height = 72 * figure.get_size_inches()
    described = []
    for ax in figure.axes:
        at = ax.get_position()
        described.append(
            {
                "box": [at.x0 * width, (1 - at.y1) * height, at.x1 * width, (1 - at.y0) * height],
                "x": {"label": ax.get_xlabel(), "limits": list(map(float, ax.get_xlim())), "scale": ax.get_xscale()},
                "y": {"label": ax.get_ylabel(), "limits": list(map(float, ax.get_ylim())), "scale": ax.get_yscale()},
            }
        )
    return json.dumps(described)
