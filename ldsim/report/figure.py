"""A figure as numbers: what the page's script (web/src/plot.js) and the static files (svg.py) are drawn from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ldsim.arrays import Array

MAX_POINTS = 600
# Shape tells the spaces apart where colour does not.
MARKERS = {"full": "diamond", "linear": "square", "latent": "circle"}

Kind = Literal["line", "marks", "link"]


@dataclass(frozen=True)
class Axis:
    """One axis.

    Attributes:
        label: quantity and unit.
        log: whether the scale is logarithmic.
        zero: whether a linear scale begins at 0.
        names: of the rows 0, 1, … that stand in place of numbers, the first on top.
        margin: on both sides of the values, as a share of their range.
    """

    label: str = ""
    log: bool = False
    zero: bool = False
    names: tuple[str, ...] = ()
    margin: float = 0.05


@dataclass(frozen=True)
class Series:
    """Points of one kind.

    Attributes:
        name: in the legend, where each name stands once; empty for none.
        colour: a name of the palette.
        x, y: finite values, of one length.
        kind: a line, marks alone, or a faint link between marks that tells no values.
        marker: "", "circle", "square", "diamond" or "triangle".
        dashed: a dashed line; markers are hollow.
        faint: a thin line behind the others.
        right: whether y is read off the right axis.
        labels: a text beside each point, or none.
    """

    name: str
    colour: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    kind: Kind = "line"
    marker: str = ""
    dashed: bool = False
    faint: bool = False
    right: bool = False
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.x) != len(self.y) or (self.labels and len(self.labels) != len(self.x)):
            raise ValueError(
                f"series {self.name!r} has {len(self.x)} values of x, {len(self.y)} of y and {len(self.labels)} labels;"
                " expected as many of each"
            )


@dataclass(frozen=True)
class Guide:
    """A line across the figure at a value of one axis, with words at its end, or at its start."""

    at: float
    text: str
    axis: Literal["x", "y", "right"] = "y"
    colour: str = "ink"
    at_start: bool = False


@dataclass(frozen=True)
class Figure:
    """Everything that is drawn.

    Attributes:
        title: what the figure shows, one sentence, for those who do not see it.
        shades: name and stretches of x, (begin, end), that lie on a darker ground.
        height: over the width of 5.2.
    """

    title: str
    x: Axis
    y: Axis
    series: tuple[Series, ...]
    right: Axis | None = None
    guides: tuple[Guide, ...] = ()
    shades: Mapping[str, tuple[tuple[float, float], ...]] | None = None
    height: float = 2.9

    @property
    def shows_something(self) -> bool:
        """Whether a series has a point that can be drawn: its values are finite, but a logarithm needs more."""
        for one in self.series:
            upright = self.right if one.right and self.right is not None else self.y
            points = zip(one.x, one.y, strict=True)
            if any((x > 0 or not self.x.log) and (y > 0 or not upright.log) for x, y in points):
                return True
        return False

    def record(self) -> dict[str, Any]:
        """As JSON holds it."""
        return asdict(self)


def curve(name: str, colour: str, x: ArrayLike, y: ArrayLike, **look: Any) -> Series:
    """The series of a curve y(x), (N,) each, thinned; `look` as `Series`."""
    xs, ys = (tuple(float(f"{value:.7g}") for value in values) for values in thinned(x, y))
    return Series(name, colour, xs, ys, **look)


def thinned(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """At most MAX_POINTS points of the curve y(x), (N,) each, that keep its peaks.

    The curve is cut into half as many runs of equal length, and each gives its lowest and its highest point. Points
    that are not finite are left out.
    """
    a, b = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 1:
        raise ValueError(f"a curve has x of shape {a.shape} and y of shape {b.shape}; expected twice the same (N,)")
    finite = np.isfinite(a) & np.isfinite(b)
    a, b = a[finite], b[finite]
    if len(a) <= MAX_POINTS:
        return a, b
    runs = np.array_split(np.arange(len(a)), MAX_POINTS // 2)
    keep = np.unique([run[pick(b[run])] for run in runs for pick in (np.argmin, np.argmax)])
    return a[keep], b[keep]
