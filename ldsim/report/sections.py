"""The sections of the report's page: each reads its part of the report and says what it means."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ldsim.report.html import Markup, element, joined, number, percent, table, text
from ldsim.report.paper import PAPER_CITATION, PAPER_MACHINE, PAPER_TABLE_1, PaperRow, paper_row
from ldsim.report.report_schema import METHODS, ROLES, SPACES

ROLE_NAMES = {"train": "training", "heldout": "held-out"}
TABLE_ONE = (
    *("object", "cells", "autoencoder, s", "PCA, s", "cubature, s", "points", "kp", "r (k)"),
    *("linear step, ms", "latent step, ms", "linear ÷ latent"),
)
MACHINE_REMARK = (
    "Milliseconds and seconds do not carry over between machines; ratios, counts and errors do. "
    f"The paper’s machine: {PAPER_MACHINE}."
)
METHOD_NAMES = {
    "autoencoder": "autoencoder",
    "pca_r": "PCA, r modes",
    "pca_kp": "PCA, kp modes",
    "pca_k": "PCA, k modes",
}


@dataclass(frozen=True)
class Section:
    """A heading, its content, and the names (or beginnings of names) of the figures that belong to it."""

    title: str
    content: tuple[Markup, ...] = ()
    figures: tuple[str, ...] = ()

    def figures_in(self, names: Iterable[str]) -> list[str]:
        """Those of `names` that belong here, in this section's order."""
        available = list(names)
        return [name for own in self.figures for name in available if name == own or name.startswith(own + "_")]


def headline_runs(report: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Space → its run of the motion that headlines are about: the first held-out one, else the first of all."""
    runs = [run for space in ("latent", "linear", "full") for run in report["simulate"][space]]
    motion = next((run["motion"] for run in runs if run["role"] == "heldout"), runs[0]["motion"] if runs else None)
    found = ((space, run) for space in SPACES for run in report["simulate"][space] if run["motion"] == motion)
    return dict(found)


def subject(report: Mapping[str, Any]) -> Section:
    """What was simulated: mesh and dimensions."""
    mesh, dims = report["mesh"], report["dims"]
    facts = (
        ("vertices", number(mesh["vertices"])),
        ("cells", joined(number(mesh["cells"]), " ", mesh["cell_type"])),
        ("quadrature points", number(mesh["quadrature_points"])),
        ("latent dimension r", number(dims["r"])),
        ("outer PCA dimension k", number(dims["k"])),
        ("matching PCA dimension kp", number(dims["kp"])),
        ("displacement decoded at rest", number(report["rest_residual_mm"], unit="mm")),
    )
    note = remark(
        "kp is the PCA dimension whose largest error on the training frames matches the autoencoder’s: "
        "the linear space that the latent one must beat."
    )
    return Section("What was simulated", (_facts(facts), note))


def table_one(report: Mapping[str, Any]) -> Section:
    """This run's row of Table 1, beside the paper's."""
    theirs = paper_row(report["experiment"])
    paper_rows = PAPER_TABLE_1 if theirs is None else (theirs,)
    name = joined(element("strong", report["experiment"]), " (this run)")
    rows = [own_row(report, name), *map(paper_cells, paper_rows)]
    remarks = [MACHINE_REMARK, *paper_remarks(paper_rows)]
    if theirs is None:
        remarks.insert(0, "The paper has no such object; its five stand here for orientation.")
    content = table(TABLE_ONE, rows, "This run as a row of the paper’s Table 1", highlight=0)
    return Section("Beside the paper", (content, *map(remark, remarks)))


def paper_remarks(rows: Iterable[PaperRow]) -> list[str]:
    """What to know of the paper's rows, and where they are from."""
    return [*(f"{row.experiment}: {row.note}" for row in rows if row.note), f"Source: {PAPER_CITATION}."]


def reconstruction(report: Mapping[str, Any]) -> Section:
    """How closely each space can hold the poses, before any dynamics."""
    rows = []
    for method in METHODS:
        cells: list[str] = [METHOD_NAMES[method]]
        for role in ROLES:
            errors = (report["reconstruction"][role] or {}).get(method) or {"max_mm": None, "mean_mm": None}
            cells += [number(errors["max_mm"]), number(errors["mean_mm"])]
        rows.append(cells)
    header = ("space", *(f"{name}, {kind} mm" for name in ("training", "held-out") for kind in ("max", "mean")))
    note = remark(
        "Each pose is projected onto the space and compared vertex by vertex. "
        "What a space cannot hold, it cannot simulate."
    )
    content = table(header, rows, "Vertex distance between poses and their reconstruction")
    return Section("What the spaces can hold", (note, content), ("error_against_k", "singular_values", "training"))


def cubature(report: Mapping[str, Any]) -> Section:
    """How few points stand for the whole solid, and at what error."""
    rows = []
    for space in ("latent", "linear"):
        entry = report["cubature"][space] or {"points": None, "relative_error": dict.fromkeys(ROLES), "seconds": None}
        errors = [number(entry["relative_error"][role]) for role in ROLES]
        rows.append((space_label(space), number(entry["points"]), *errors, number(entry["seconds"])))
        virtual = entry.get("virtual")
        if virtual is not None:
            errors = [number(virtual["relative_error"][role]) for role in ROLES]
            label = joined(space_label(space), text(", virtual points"))
            rows.append((label, number(virtual["points"]), *errors, text("")))
    header = ("space", "points", "relative error, training", "relative error, held-out", "seconds")
    note = remark(
        "Forces are summed over a weighted few of the quadrature points; the error is that of the reduced force. "
        "Held-out poses are of the training motions, kept back from the fit. Virtual points, where there are "
        "some, are what was stepped; where they aim at the forces of the true poses instead of the decoded ones, "
        "their errors are larger and not to be compared."
    )
    return Section("Cubature", (note, table(header, rows, "Cubature sets of the two reduced spaces")), ("cubature",))


def simulation(report: Mapping[str, Any]) -> Section:
    """Times, counts and errors of every run, and the speedups."""
    header = (
        *("space", "motion", "frames", "median step, ms", "95th percentile, ms", "iterations", "evaluations"),
        *("online error", "restarted every 0.25 s", "max, mm", "mean, mm", "outcome"),
    )
    rows = [_run_row(space, run) for space in SPACES for run in report["simulate"][space]]
    note = remark(
        "Online error: mean vertex distance to the full-space run of the same motion over its mean displacement. "
        "Iterations and evaluations are per step."
    )
    faster = element(
        "p",
        *("By medians, a latent step is ", number(report["speedup"]["latent_over_linear"], unit="×")),
        *(" as fast as a linear one and ", number(report["speedup"]["latent_over_full"], unit="×")),
        " as fast as one in full space, each with its best settings.",
    )
    content = (faster, table(header, rows, "Every run of every motion"), note)
    return Section("Simulation: speed beside error", content, ("step_times", "online_error"))


def trust(report: Mapping[str, Any]) -> Section:
    """Whether the score told where the latent runs went wrong."""
    header = (
        *("motion", "median score", "distrusted above", "distrusted frames"),
        *("rank correlation with the true error", "that of its memory"),
    )
    rows = [
        (
            joined(run["motion"], " ", element("small", ROLE_NAMES[run["role"]])),
            *(number(run["trust"][key]) for key in ("median", "threshold")),
            percent(run["trust"]["distrusted"]),
            *(number(run["trust"][f"rank_correlation{what}"]) for what in ("", "_remembered")),
        )
        for run in report["simulate"]["latent"]
        if run["trust"] is not None
    ]
    note = remark(
        "The score is the distance of the latent state to the nearest training code; 99 % of the training codes "
        "score at most 1. It needs no full-space run, the true error does. Its memory is its mean over the last half "
        "second or so: an error that was made stays for a while."
    )
    content = table(header, rows, "Trust in the latent runs")
    return Section("How far to trust it", (note, content) if rows else (), ("trust",))


def cost(report: Mapping[str, Any]) -> Section:
    """What each stage took."""
    rows = [
        (name, number(stage["seconds"]), number(stage["peak_memory_mb"])) for name, stage in report["stages"].items()
    ]
    content = table(("stage", "seconds", "peak memory, MB"), rows, "Wall time and peak memory of each stage")
    return Section("What it cost", (content,) if rows else ())


def machine(report: Mapping[str, Any]) -> Section:
    """Where the run was made."""
    here = report["machine"]
    versions = [(name, element("code", version)) for name, version in here["versions"].items()]
    facts = [("processor", text(here["cpu"])), ("cores", number(here["cores"])), ("graphics card", text(here["gpu"]))]
    return Section("Machine and versions", (_facts([*facts, *versions]),))


def other_figures(figures: Mapping[str, str], known: Sequence[Section]) -> Section:
    """The figures that no section claims."""
    claimed = {name for section in known for name in section.figures_in(figures)}
    return Section("More figures", figures=tuple(name for name in figures if name not in claimed))


def own_row(report: Mapping[str, Any], name: Markup) -> tuple[str, ...]:
    """A run as a row of Table 1."""
    dims, stages, runs = report["dims"], report["stages"], headline_runs(report)
    seconds = [number((stages.get(stage) or {}).get("seconds")) for stage in ("train", "pca", "cubature")]
    points = [number((report["cubature"][space] or {}).get("points")) for space in ("latent", "linear")]
    medians = [number((runs.get(space) or {}).get("median_step_ms")) for space in ("linear", "latent")]
    return (
        name,
        number(report["mesh"]["cells"]),
        *seconds,
        joined(points[0], " latent, ", points[1], " linear"),
        number(dims["kp"]),
        joined(number(dims["r"]), " (", number(dims["k"]), ")"),
        *medians,
        number(report["speedup"]["latent_over_linear"]),
    )


def paper_cells(row: PaperRow) -> tuple[str, ...]:
    """A row of the paper's Table 1."""
    seconds = (f"{row.autoencoder_s:g}", f"{row.pca_s:g}", f"{row.cubature_s:g}")
    size = (str(row.kp), f"{row.r} ({row.k})")
    times = (f"{row.linear_ms:g}", f"{row.latent_ms:g}", f"{row.speedup:.2f}")
    return (f"{row.experiment} (paper)", number(row.tets), *seconds, number(row.points), *size, *times)


def _run_row(space: str, run: Mapping[str, Any]) -> tuple[str, ...]:
    error = run["online_error"] or dict.fromkeys(("relative", "windowed", "max_mm", "mean_mm"))
    counts = (run["frames"], run["median_step_ms"], run["p95_step_ms"], run["iterations"], run["evaluations"])
    outcome = element("span", "diverged", class_="bad") if run["diverged"] else joined("finished")
    return (
        space_label(space),
        joined(run["motion"], " ", element("small", ROLE_NAMES[run["role"]])),
        *map(number, counts),
        percent(error["relative"]),
        percent(error["windowed"]),
        number(error["max_mm"]),
        number(error["mean_mm"]),
        outcome,
    )


def space_label(name: str) -> Markup:
    """The name of a space with the colour that it has in every figure."""
    return element("span", name, class_=f"space {name}")


def _facts(facts: Iterable[tuple[str, Markup]]) -> Markup:
    pairs = (element("div", element("dt", name), element("dd", value)) for name, value in facts)
    return element("dl", *pairs, class_="facts")


def remark(sentence: str) -> Markup:
    return element("p", sentence, class_="note")
