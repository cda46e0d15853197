"""The comparison of several runs as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ldsim.report.compare_runs import REDUCED, Reported
from ldsim.report.html import Markup, element, joined, number, percent, table
from ldsim.report.page import head, rendered, warning_list
from ldsim.report.paper import paper_row
from ldsim.report.report_schema import ROLES, SPACES
from ldsim.report.sections import (
    MACHINE_REMARK,
    ROLE_NAMES,
    TABLE_ONE,
    Section,
    own_row,
    paper_cells,
    paper_remarks,
    remark,
)


def render_comparison(runs: Sequence[Reported], comparison: Mapping[str, Any], figures: Mapping[str, str]) -> str:
    """The page of a comparison, which needs nothing from outside itself; its links lead to the runs' reports.

    Args:
        comparison: of `compare_runs.comparison`, of the same runs in the same order.
        figures: of `compare_figures.figures`.
    """
    records = comparison["runs"]
    sections = (_table_one(runs, records), _speed(records), _spaces(records), _trust(records), _made(runs, records))
    names = ", ".join(run.name for run in runs)
    opening = element(
        "header",
        element("p", "ldsim comparison · ", element("time", comparison["created"]), class_="kicker"),
        element("h1", names),
        element("p", _said(len(runs)), class_="lede"),
    )
    body = element(
        "main",
        opening,
        warning_list(comparison["warnings"]),
        *(rendered(section, figures) for section in sections),
    )
    page = element("html", head(f"{names} · ldsim comparison"), element("body", body), lang="en")
    return f"<!DOCTYPE html>\n{page}\n"


def _said(count: int) -> str:
    runs = "One finished run" if count == 1 else f"{count} finished runs side by side"
    return f"{runs}: what each model is, how fast it steps, and how far it is from the full space."


def _table_one(runs: Sequence[Reported], records: Sequence[Mapping[str, Any]]) -> Section:
    """Table 1 of the paper for all runs, the paper's row below each that has one."""
    rows: list[Sequence[str]] = []
    theirs = []
    for run, record in zip(runs, records, strict=True):
        rows.append(own_row(run.report, _linked(record)))
        if (row := paper_row(run.report["experiment"])) is not None:
            rows.append(paper_cells(row))
            theirs.append(row)
    remarks = [MACHINE_REMARK, *paper_remarks(dict.fromkeys(theirs))] if theirs else []
    content = table(TABLE_ONE, rows, "The runs as rows of the paper’s Table 1")
    return Section("Table 1", (content, *map(remark, remarks)))


def _speed(records: Sequence[Mapping[str, Any]]) -> Section:
    """Step times of the three spaces beside the online errors."""
    header = (
        *("object", *(f"{space} step, ms" for space in SPACES), "linear ÷ latent", "full ÷ latent"),
        *(f"{space} error, {ROLE_NAMES[role]}" for role in ROLES for space in REDUCED),
        *(f"{space}, {ROLE_NAMES['heldout']}, restarted" for space in REDUCED),
    )
    rows = [
        (
            _linked(record),
            *(number(record["step_ms"][space]) for space in SPACES),
            *(number(record["speedup"][f"latent_over_{space}"]) for space in ("linear", "full")),
            *(_error(record["online"][role][space], "relative") for role in ROLES for space in REDUCED),
            *(_error(record["online"]["heldout"][space], "windowed") for space in REDUCED),
        )
        for record in records
    ]
    motions = "; ".join(f"{record['name']}: {record['motion']}" for record in records if record["motion"] is not None)
    notes = (
        f"Step times are medians on one motion of each run ({motions}), ratios those over all motions. "
        if motions
        else "",
        "Errors are the mean vertex distance to the full-space run over its mean displacement; where a run has several "
        "motions of a role, the worst one counts. Restarted: from the full-space state every so often (0.25 s unless "
        "simulate.window says otherwise).",
    )
    content = (table(header, rows, "Step times beside online errors"), remark("".join(notes)))
    return Section("Speed beside error", content, ("error_against_time", "online_errors", "step_times"))


def _error(run: Mapping[str, Any] | None, key: str) -> Markup:
    if run is not None and run["diverged"]:
        return element("span", "diverged", class_="bad", title=f"motion {run['motion']}")
    return percent(None if run is None else run[key])


def _spaces(records: Sequence[Mapping[str, Any]]) -> Section:
    """What the spaces hold, and what their cubature leaves out."""
    header = (
        *("object", *(f"autoencoder, {ROLE_NAMES[role]}, max mm" for role in ROLES)),
        *(f"PCA kp, {ROLE_NAMES[role]}, max mm" for role in ROLES),
        *(f"{space} cubature error, {ROLE_NAMES[role]}" for space in reversed(REDUCED) for role in ROLES),
    )
    rows = [
        (
            _linked(record),
            *(number(record["reconstruction_max_mm"][role][of]) for of in ("autoencoder", "pca_kp") for role in ROLES),
            *(percent(record["cubature_error"][space][role]) for space in reversed(REDUCED) for role in ROLES),
        )
        for record in records
    ]
    note = "Largest vertex distance of a pose to its reconstruction; relative error of the reduced forces."
    return Section("Spaces and cubature", (table(header, rows, "Reconstruction and cubature errors"), remark(note)))


def _trust(records: Sequence[Mapping[str, Any]]) -> Section:
    """Whether the trust score told where the latent runs went wrong."""
    header = (
        "object",
        *(f"{what}, {ROLE_NAMES[role]}" for role in ROLES for what in ("distrusted", "rank correlation")),
    )
    rows = []
    for record in records:
        latent = [record["online"][role]["latent"] or {} for role in ROLES]
        cells = ((percent(run.get("distrusted")), number(run.get("rank_correlation_remembered"))) for run in latent)
        rows.append((_linked(record), *(cell for pair in cells for cell in pair)))
    note = (
        "Of the worst latent run of each role: the share of frames that the trust score warns of, and the rank "
        "correlation of its memory over half a second with the true error."
    )
    return Section("Trust", (table(header, rows, "Trust in the latent runs"), remark(note)))


def _made(runs: Sequence[Reported], records: Sequence[Mapping[str, Any]]) -> Section:
    """Where, when and at what cost."""
    header = ("object", "reported", "ldsim", "processor", "cores", "all stages, s", "of that snapshot, s", "folder")
    rows = []
    for run, record in zip(runs, records, strict=True):
        machine, stages = run.report["machine"], run.report["stages"]
        seconds = {stage: cost["seconds"] for stage, cost in stages.items() if cost["seconds"] is not None}
        rows.append(
            (
                _linked(record),
                element("time", run.report["created"]),
                machine["versions"].get("ldsim", "–"),
                machine["cpu"],
                number(machine["cores"]),
                number(sum(seconds.values()) if seconds else None),
                number(seconds.get("snapshot")),
                element("code", str(run.folder)),
            )
        )
    return Section("How they were made", (table(header, rows, "Time, machine and cost of each run"),))


def _linked(record: Mapping[str, Any]) -> Markup:
    """The name of a run, a link to its report."""
    return joined(element("a", record["name"], href=record["report"]))
