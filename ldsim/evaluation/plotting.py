"""What all figures share: colours, axes, thinning, and SVG that is small and reads on light and dark pages.

Matplotlib draws; afterwards the ink's stand-in colour becomes `currentColor`, which a style inside the SVG sets for
light and for dark, text stays text, and identifiers are made unlike those of other figures in one page.
"""

from __future__ import annotations

import hashlib
import re
from html import escape
from io import StringIO

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from ldsim.evaluation.html import SUPERSCRIPTS

Array = NDArray[np.float64]

# Okabe and Ito's palette, its blue a little lighter: at least 3 : 1 on white and on near-black.
INK = "#010203"
LINEAR = "#1f83c4"
LATENT = "#d55e00"
FULL = "#7a828c"
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
    text = re.sub(r"font-family: [^;\"]*;? ?", "", text.replace(INK, "currentColor"))
    text = re.sub(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', _opening(label), text, count=1)
    return re.sub(r"\n\s*", "\n", text)


def _opening(label: str) -> str:
    """The replacement pattern for the <svg> tag: scalable, labelled, styled."""
    name = escape(label).replace("\\", r"\\")
    return (
        r'<svg class="ldsim-figure" viewBox="\1" role="img" xmlns="http://www.w3.org/2000/svg" '
        rf'xmlns:xlink="http://www.w3.org/1999/xlink"><title>{name}</title>{_STYLE}'
    )
