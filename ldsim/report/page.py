"""The pages as HTML that needs nothing from outside itself: templates/ filled in, every text escaped."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ldsim.report.figure import Figure
from ldsim.report.paper import PAPER_CITATION, PAPER_MACHINE, PAPER_TABLE_1, paper_row
from ldsim.report.pictures import Picture
from ldsim.report.replay import Replay
from ldsim.report.schema import ROLE_NAMES, ROLES, RunNumbers
from ldsim.report.wording import readable
from ldsim.run import REDUCED, SPACES
from ldsim.web import bundle, inlined, page

MISSING = Markup('<span class="null" title="not measured">–</span>')


def render_page(
    report: RunNumbers,
    figures: Mapping[str, tuple[Figure, str]],
    picture: Picture | None,
    replay: Replay | None = None,
) -> str:
    """The report of a run.

    Args:
        report: its numbers and warnings.
        figures: name → figure and the SVG for readers without script. A section shows those whose name is or begins
            with one of its own, such as `online_error_x_2`; others follow at the end.
        picture: the animation, for readers without script.
        replay: the motions to play, in its place.
    """
    return render("report.html", figures, report=report, picture=picture, replay=replay)


def render(template: str, figures: Mapping[str, tuple[Figure, str]], **values: Any) -> str:
    """A page from its template."""
    return _environment().get_template(template).render(shelf=Shelf(figures), **values)


class Shelf:
    """The figures that no section has taken yet."""

    def __init__(self, figures: Mapping[str, tuple[Figure, str]]) -> None:
        self.left = dict(figures)

    def take(self, *names: str) -> list[tuple[str, Markup, Markup]]:
        """The figures that are called so, or begin so: title, JSON for the script, and SVG."""
        taken = [name for own in names for name in self.left if name == own or name.startswith(f"{own}_")]
        return [self._give(name) for name in taken]

    def rest(self) -> list[tuple[str, Markup, Markup]]:
        """All that are left."""
        return [self._give(name) for name in list(self.left)]

    def _give(self, name: str) -> tuple[str, Markup, Markup]:
        figure, svg = self.left.pop(name)
        return figure.title, Markup(inlined(figure.record())), Markup(svg)  # noqa: S704 the SVG's texts are escaped by `svg.py`


def number(value: float | None, factor: float = 1.0, unit: str = "") -> Markup:
    """A number rounded for reading that carries its exact value for programs, or a dash where it was not measured.

    Args:
        value: as the report holds it.
        factor: from the report's unit to the one shown, such as 100 for per cent.
        unit: written after the number.
    """
    if value is None:
        return MISSING
    text = readable(value if factor == 1 else value * factor) + (f"\u202f{unit}" if unit else "")
    exact = json.dumps(value)
    title = "" if exact == text else Markup(' title="{}"').format(exact)
    return Markup('<data value="{}"{}>{}</data>').format(exact, title, text)


def percent(value: float | None) -> Markup:
    """A fraction as per cent."""
    return number(value, 100, "%")


def encoded(data: bytes) -> str:
    """Bytes in base64."""
    return b64encode(data).decode("ascii")


@cache
def _environment() -> Environment:
    found = Environment(
        loader=PackageLoader("ldsim.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.filters |= {"number": number, "percent": percent, "encoded": encoded}
    found.globals |= {
        "REDUCED": REDUCED,
        "SPACES": SPACES,
        "ROLES": ROLES,
        "ROLE_NAMES": ROLE_NAMES,
        "PAPER_CITATION": PAPER_CITATION,
        "PAPER_MACHINE": PAPER_MACHINE,
        "PAPER_TABLE_1": PAPER_TABLE_1,
        "paper_row": paper_row,
        "palette": Markup(page("palette.css")),
        "script": Markup(bundle("report")),
    }
    return found
