"""The report as one self-contained HTML page that tells a run's story in order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ldsim.report.html import Markup, element, joined, number, percent, picture, text
from ldsim.report.page_style import STYLE
from ldsim.report.replay import Replay
from ldsim.report.replay_figure import replay_figure
from ldsim.report.report_schema import check_report
from ldsim.report.sections import (
    Section,
    cost,
    cubature,
    headline_runs,
    machine,
    other_figures,
    reconstruction,
    simulation,
    subject,
    table_one,
    trust,
)
from ldsim.web import bundle, page


def render_page(
    report: Mapping[str, Any],
    figures: Mapping[str, str],
    pictures: Mapping[str, bytes],
    warnings: Sequence[str],
    replay: Replay | None = None,
) -> str:
    """The report of a run as HTML that needs nothing from outside itself.

    Args:
        report: the content of report.json.
        figures: name → SVG text, trusted and put in as it is. Known names go to their section
            (`error_against_k`, `singular_values`, `training`, `cubature`, `step_times`, `online_error`, and names
            that begin with one of these, such as `online_error_x_2`); others follow at the end.
        pictures: caption → PNG or WebP bytes, shown near the top.
        warnings: what a reader must know first, one sentence each.
        replay: the motions to play, above the pictures.

    Raises:
        ValueError: if the report breaks the contract of report.json, or a picture is neither PNG nor WebP.
    """
    violations = check_report(report)
    if violations:
        raise ValueError("the report breaks the contract of report.json: " + "; ".join(violations))
    makers = (subject, table_one, reconstruction, cubature, simulation, trust, cost, machine)
    sections = [maker(report) for maker in makers]
    sections.append(other_figures(figures, known=sections))
    body = element(
        "main",
        _opening(report),
        warning_list(warnings),
        replay_figure(replay) if replay else "",
        element("div", *(picture(name, data) for name, data in pictures.items()), class_="pictures"),
        *(rendered(section, figures) for section in sections if section.content or section.figures_in(figures)),
    )
    return (
        "<!DOCTYPE html>\n"
        + element("html", head(f"{report['experiment']} · ldsim report"), element("body", body), lang="en")
        + "\n"
    )


def head(title: str) -> Markup:
    """The head of a page that needs nothing from outside itself."""
    return element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", title),
        element("style", Markup(page("palette.css") + STYLE)),
        element("script", Markup(bundle("report"))),
    )


def _opening(report: Mapping[str, Any]) -> Markup:
    """Name, one sentence, and the three figures that belong together: how fast, how much faster, how far off."""
    dims, mesh = report["dims"], report["mesh"]
    sentence = element(
        "p",
        *("A solid of ", number(mesh["cells"]), " cells, moved by ", number(dims["r"]), " numbers: a network over "),
        *(number(dims["k"]), " PCA modes decodes them to its ", number(mesh["vertices"]), " vertices."),
        class_="lede",
    )
    kicker = element("p", "ldsim report · ", element("time", report["created"]), class_="kicker")
    title = element("h1", report["experiment"])
    return element("header", kicker, title, sentence, _key_figures(report))


def _key_figures(report: Mapping[str, Any]) -> Markup:
    runs = headline_runs(report)
    latent = runs.get("latent")
    error = (latent or {}).get("online_error") or {"relative": None, "windowed": None}
    where = "no latent run" if latent is None else f"on {_role(latent['role'])} motion {latent['motion']}"
    times_faster = report["speedup"]["latent_over_linear"]
    return element(
        "dl",
        _key_figure("a latent step", number((latent or {}).get("median_step_ms"), unit="ms"), text("median, "), where),
        _key_figure(
            "against linear",
            number(times_faster, unit="×"),
            joined("as fast; against full space ", number(report["speedup"]["latent_over_full"], unit="×")),
        ),
        _key_figure(
            "away from full space",
            percent(error["relative"]),
            joined("of the mean displacement; restarted every 0.25 s: ", percent(error["windowed"])),
            f"; {where}" if latent else "",
        ),
        class_="key",
    )


def _role(role: str) -> str:
    return "held-out" if role == "heldout" else "training"


def _key_figure(name: str, value: Markup, *remark: str) -> Markup:
    return element("div", element("dt", name), element("dd", value), element("dd", *remark, class_="remark"))


def warning_list(warnings: Sequence[str]) -> Markup:
    """What a reader must know first, or that there is nothing."""
    if not warnings:
        return element("p", "No warnings: every check passed.", class_="calm")
    items = element("ul", *(element("li", warning) for warning in warnings))
    return element("section", element("h2", "Read this first"), items, class_="warnings")


def rendered(section: Section, figures: Mapping[str, str]) -> Markup:
    """A section: heading, what it says, its figures."""
    mine = [element("div", Markup(figures[name]), class_="plot") for name in section.figures_in(figures)]
    plots = element("div", *mine, class_="plots") if mine else ""
    return element("section", element("h2", section.title), *section.content, plots)
