"""The page: whole, balanced, escaped, self-contained, and with every number of the report."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

from ldsim.report.figure import Axis, Figure, Series, curve
from ldsim.report.page import number, render_page
from ldsim.report.paper import PAPER_TABLE_1
from ldsim.report.pictures import Picture
from ldsim.report.schema import RunNumbers
from ldsim.report.svg import drawn
from ldsim.report.wording import counted, readable
from tests.report.example_report import example_report

WEBP = b"RIFF\x00\x00\x00\x00WEBP" + bytes(8)
VOID = ("img", "meta", "br", "input")
LOADING_ATTRIBUTES = ("src", "href", "xlink:href", "srcset", "data", "action", "poster")


class Outline(HTMLParser):
    """Collects tags, texts, exact values and ids, and refuses tags that do not close in order."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.texts: list[str] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def values(self, tag: str, attribute: str) -> list[str]:
        return [value for where, name, value in self.attributes if (where, name) == (tag, attribute)]


def numbers_of(value: Any) -> Iterator[float]:
    if isinstance(value, dict | list):
        for child in value.values() if isinstance(value, dict) else value:
            yield from numbers_of(child)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield value


def figures() -> dict[str, tuple[Figure, str]]:
    """Three figures, one of which no section knows."""
    marks = Series("median", "latent", (0.25, 100.0), (1, 0), "marks", "circle")
    values = curve("singular value", "linear", np.arange(3), np.array([3.0, 2.0, 1.0]))
    made = {
        "step_times": Figure("Times", Axis("ms", log=True), Axis(names=("full", "latent")), (marks,)),
        "singular_values": Figure("Values", Axis("mode"), Axis("singular value"), (values,)),
        "something_else": Figure("Else", Axis("mode"), Axis("value"), (values,)),
    }
    return {name: (figure, drawn(figure)) for name, figure in made.items()}


def page_of(report: dict[str, Any], warnings: tuple[str, ...] = ()) -> str:
    numbers = RunNumbers.model_validate(report | {"warnings": list(warnings)})
    return render_page(numbers, figures(), Picture("x_2.webp", "Motion", WEBP))


def test_every_tag_closes_in_order():
    assert "html" in page_of(example_report()) and Outline(page_of(example_report(), ("careful",)))


def test_nothing_is_loaded_from_elsewhere():
    outline = Outline(page_of(example_report()))
    loaded = [value for _, name, value in outline.attributes if name in LOADING_ATTRIBUTES]
    assert loaded and all(value.startswith(("#", "data:image/")) for value in loaded)
    assert not any(tag in ("link", "iframe") for tag, _, _ in outline.attributes)
    page = page_of(example_report())
    assert "@import" not in page and "fetch(" not in page and "XMLHttpRequest" not in page
    assert page.count("url(") == page.count("url(#")


def test_identifiers_are_unique_though_figures_share_a_page():
    ids = [value for _, name, value in Outline(page_of(example_report())).attributes if name == "id"]
    assert ids and len(ids) == len(set(ids))


def test_every_number_of_the_report_is_there_exactly():
    report = example_report()
    exact = set(map(float, Outline(page_of(report)).values("data", "value")))
    assert set(numbers_of(report)) <= exact


def test_every_text_of_the_report_is_there():
    report = example_report()
    text = "".join(Outline(page_of(report)).texts)
    machine = report["machine"]
    for expected in (machine["cpu"], *machine["versions"].values(), report["created"], "x_1", "x_2", *report["stages"]):
        assert expected in text


def test_hostile_names_are_shown_and_not_run():
    report = example_report()
    hostile = "<script>alert('x')</script>\"&"
    report["experiment"] = report["machine"]["cpu"] = report["simulate"]["latent"][0]["motion"] = hostile
    page = page_of(report, (hostile,))
    assert page.count("<script") == page_of(example_report()).count("<script")
    assert "".join(Outline(page).texts).count(hostile) >= 4


def test_warnings_come_before_every_table_and_figure():
    page = page_of(example_report(), ("the solid has left the building",))
    assert page.index("the solid has left the building") < min(page.index("<table"), page.index('<div class="plot">'))


def test_a_page_without_warnings_says_so():
    assert "No warnings" in page_of(example_report())


@pytest.mark.parametrize("row", PAPER_TABLE_1, ids=lambda row: row.experiment)
def test_the_papers_row_of_the_same_object_stands_beside_the_run(row):
    text = "".join(Outline(page_of(example_report() | {"experiment": row.experiment})).texts)
    shown = [other.experiment for other in PAPER_TABLE_1 if f"{other.experiment} (paper)" in text]
    assert shown == [row.experiment]


def test_an_object_the_paper_does_not_know_gets_all_five_rows():
    text = "".join(Outline(page_of(example_report() | {"experiment": "pendulum"})).texts)
    assert all(f"{row.experiment} (paper)" in text for row in PAPER_TABLE_1)
    assert "for orientation" in text


def test_a_diverged_run_is_marked():
    report = example_report()
    assert 'class="bad"' not in page_of(report)
    report["simulate"]["linear"][0]["diverged"] = True
    assert page_of(report).count('class="bad"') == 1


def test_what_was_not_measured_is_a_dash():
    report = example_report()
    assert number(None) == '<span class="null" title="not measured">–</span>'
    before = page_of(report).count("not measured")
    report["reconstruction"]["test"] = None
    assert page_of(report).count("not measured") == before + 8


@pytest.mark.parametrize(
    ("ratio", "words"), [(4.0, "is 4.00\u202f× as fast as one"), (0.5, "takes 2.00\u202f× as long as one")]
)
def test_a_space_that_is_slower_is_said_to_take_longer(ratio: float, words: str) -> None:
    report = example_report()
    report["speedup"]["latent_over_linear_kp"] = ratio
    assert words in "".join(Outline(page_of(report)).texts).replace("\n", " ")


def test_where_the_latent_space_was_lost_no_linear_one_is_told_to_be_worse() -> None:
    report = example_report()
    report["speedup"] |= {"latent_over_linear_equal_error": None, "latent_error": None}
    page = page_of(report)
    assert "is as good" not in page and "no number: the latent space was lost, or nothing was judged" in page
    report["speedup"]["latent_error"] = 0.1
    assert "no number: no linear space that was stepped is as good" in page_of(report)


@pytest.mark.parametrize(("kind", "told"), [("autoencoder", False), ("condensed", True)])
def test_what_pulls_and_weight_move_beside_the_coordinates_is_told_to_be_left_out(kind: str, told: bool) -> None:
    page = page_of(example_report() | {"kind": kind})
    assert ("The condensed space is shown without what pulls and weight move" in page) == told
    assert ("What a space cannot hold, it cannot" in page) != told


def test_a_run_that_simulated_nothing_still_has_a_page():
    report = example_report()
    report["simulate"] = {"full": [], "linear": [], "latent": []}
    report["cubature"] = {"latent": None, "linear": None}
    report["stages"] = {}
    assert Outline(page_of(report))


def test_a_figure_without_a_section_is_not_lost():
    page = page_of(example_report())
    assert page.count('<div class="plot">') == 3 and page.index("More figures") < page.index('"title":"Else"')


def test_figures_are_numbers_for_the_script_and_drawings_for_readers_without_it():
    page = page_of(example_report())
    records = re.findall(
        r'<div class="plot"><h3>\w+</h3><script type="application/json">(.*?)</script><noscript><svg', page
    )
    assert [json.loads(record) for record in records] == [
        json.loads(json.dumps(figures()[name][0].record()))
        for name in ("step_times", "singular_values", "something_else")
    ]


def test_a_hostile_name_in_a_figure_stays_text():
    hostile = "</script></noscript><script>alert('x')</script>"
    figure = Figure(hostile, Axis(hostile), Axis("y"), (curve(hostile, "latent", np.arange(3), np.arange(3)),))
    page = render_page(RunNumbers.model_validate(example_report()), {hostile: (figure, drawn(figure))}, None)
    assert "<script>alert" not in page and Outline(page)


def test_the_animation_has_its_caption():
    assert "<figcaption>Motion</figcaption>" in page_of(example_report())


def test_a_restarted_error_is_told_with_its_window():
    assert page_of(example_report()).count("restarted every 0.375 s") == 2


def test_every_entry_of_the_contents_leads_to_a_section():
    outline = Outline(page_of(example_report()))
    entries = [href for href in outline.values("a", "href") if href.startswith("#")]
    assert len(entries) >= 8 and {entry[1:] for entry in entries} <= set(outline.values("section", "id"))


def test_every_figure_has_its_title():
    text = page_of(example_report())
    assert all(f"<h3>{figure.title}</h3>" in text for figure, _ in figures().values())


def test_the_verdict_comes_first_and_the_configuration_can_be_copied():
    report = example_report()
    text = page_of(report)
    assert text.index("the latent space is so so.".capitalize()) < text.index("<dl")
    assert f'<pre tabindex="0">{report["made_from"]["configuration"]}</pre>' in text and "ldsim make x.yaml" in text


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0, "0"),
        (0.0, "0"),
        (10, "10"),
        (29686, "29\u202f686"),
        (4.0, "4.00"),
        (138.2, "138"),
        (1203.5, "1\u202f204"),
        (0.0623, "0.0623"),
        (-0.5, "-0.500"),
        (1.234e-7, "1.23 · 10⁻⁷"),
    ],
)
def test_numbers_read_well(value, expected):
    assert readable(value) == expected


def test_one_thing_is_not_said_to_be_several():
    assert [counted(n, "number") for n in (1, 2, 1200)] == ["1 number", "2 numbers", "1\u202f200 numbers"]
