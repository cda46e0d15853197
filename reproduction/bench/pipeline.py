"""What finished runs measured, as tables and as rows with goals.

Reads report.json and measures nothing itself: `make EXPERIMENT=…` does. Prints the tables of docs/measurements.md and
writes reproduction/results/pipeline.json.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ldsim.run import SPACES
from ldsim.settings import STAGES
from reproduction.harness import Row, called, parser, row, show, write_results

Report = dict[str, Any]

NAME = "pipeline"
# The code that the numbers of a run depend on.
ROOMS = [f"ldsim/{room}" for room in ("mechanics", "space", "cubature", "learn", "dynamics", "pipeline")]

# Issue 2, Done when: goals of x, by quantity.
GOALS = {
    "r": "<= 10",
    "autoencoder max error, training": "<= 9",
    "autoencoder mean error, training": "<= 0.5",
    "rest residual": "<= 1e-9",
    "latent cubature error, poses kept back": "<= 0.05",
    "latent cubature points": "<= 150",
    "linear step over latent step, kp": ">= 5",
    "full step over latent step": ">= 500",
    "online error, latent, x_1": "<= 0.1",
    "all stages": "<= 2400",
}


def number(value: float | None, digits: int = 3) -> str:
    """A number for a table; null is a dash."""
    return "–" if value is None else f"{value:,.{digits}g}" if abs(value) < 1000 else f"{value:,.0f}"


def pair(entry: Report | None) -> str:
    return "–" if entry is None else f"{number(entry['max_mm'])} / {number(entry['mean_mm'])}"


def table(title: str, head: list[str], lines: list[list[str]]) -> str:
    """A Markdown table under a heading."""
    rows = [head, ["---"] * len(head), *lines]
    return f"## {title}\n\n" + "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


def size_table(reports: list[Report], sizes: list[float]) -> str:
    def line(name: str, values: list[object]) -> list[str]:
        return [name, *(f"{value:,}" if isinstance(value, int) else str(value) for value in values)]

    lines = [
        *(
            line(f"`mesh.{key}`", [r["mesh"][key] for r in reports])
            for key in ("vertices", "cells", "quadrature_points")
        ),
        *(line(f"`dims.{key}`", [r["dims"][key] for r in reports]) for key in ("k", "r", "kp")),
        line("size of the run's folder, MB", [f"{size:,.0f}" for size in sizes]),
    ]
    return table("Size", ["", *(r["experiment"] for r in reports)], lines)


def reconstruction_table(reports: list[Report]) -> str:
    methods = ("autoencoder", "pca_r", "pca_kp", "pca_k")
    lines = [
        [f"{role}, {method}", *(pair((r["reconstruction"][role] or {}).get(method)) for r in reports)]
        for role in ("train", "validation", "test")
        for method in methods
    ]
    lines.append(["`rest_residual_mm`", *(number(r["rest_residual_mm"]) for r in reports)])
    return table("Reconstruction, mm (max / mean)", ["", *(r["experiment"] for r in reports)], lines)


def cubature_table(reports: list[Report]) -> str:
    lines = []
    for space in ("latent", "linear"):
        sets = [r["cubature"][space] for r in reports]
        errors = [(entry["relative_error"]["fitted"], entry["relative_error"]["kept_back"]) for entry in sets]
        lines.append([f"{space}: points", *(str(entry["points"]) for entry in sets)])
        lines.append([f"{space}: relative error, fitted / kept-back poses", *(f"{a:.3f} / {b:.3f}" for a, b in errors)])
        lines.append([f"{space}: seconds", *(f"{entry['seconds']:.1f}" for entry in sets)])
    return table("Cubature", ["", *(r["experiment"] for r in reports)], lines)


def simulation_table(reports: list[Report]) -> str:
    lines = []
    for report in reports:
        for space in SPACES:
            for entry in report["simulate"][space]:
                error: Report = entry["online_error"] or dict.fromkeys(("relative", "windowed", "max_mm", "mean_mm"))
                lines.append(
                    [
                        f"{report['experiment']}, {entry['motion']} ({entry['role']})",
                        space,
                        *(number(entry[key]) for key in ("median_step_ms", "p95_step_ms", "iterations", "evaluations")),
                        *(
                            "–" if error[key] is None else f"{100 * error[key]:.1f} %"
                            for key in ("relative", "windowed")
                        ),
                        *(number(error[key]) for key in ("max_mm", "mean_mm")),
                        "yes" if entry["diverged"] else "no",
                    ]
                )
    head = ["motion (role)", "space", "median step, ms", "95th percentile, ms", "iterations", "evaluations"]
    head += ["online error", "windowed", "max mm", "mean mm", "diverged"]
    return table("Simulation", head, sorted(lines, key=lambda line: line[0].split(",")[0] != "demo"))


def cost_table(reports: list[Report]) -> str:
    lines = []
    for stage in STAGES:
        cells = [r["stages"][stage] for r in reports]
        lines.append([stage, *(f"{c['seconds']:.1f} / {c['peak_memory_mb']:,.0f}" for c in cells)])
    lines.append(["together, s", *(f"{total_seconds(r):.0f}" for r in reports)])
    for key in ("latent_over_linear_equal_error", "latent_over_linear_kp", "latent_over_full"):
        lines.append([f"`speedup.{key}`", *(number(r["speedup"][key]) for r in reports)])
    title = "Cost of the stages: seconds / peak memory, MB; and speedups"
    return table(title, ["", *(r["experiment"] for r in reports)], lines)


def total_seconds(report: Report) -> float:
    return float(sum(stage["seconds"] for stage in report["stages"].values()))


def rows_of(report: Report) -> list[Row]:
    """The rows that the issue names; goals are those of x."""
    autoencoder = report["reconstruction"]["train"]["autoencoder"]
    latent = report["cubature"]["latent"]
    values: list[tuple[str, float | None, str]] = [
        ("r", report["dims"]["r"], ""),
        ("autoencoder max error, training", autoencoder["max_mm"], "mm"),
        ("autoencoder mean error, training", autoencoder["mean_mm"], "mm"),
        ("rest residual", report["rest_residual_mm"], "mm"),
        ("latent cubature error, poses kept back", latent["relative_error"]["kept_back"], ""),
        ("latent cubature points", latent["points"], ""),
        ("linear step over latent step, kp", report["speedup"]["latent_over_linear_kp"], ""),
        ("linear step over latent step, equal error", report["speedup"]["latent_over_linear_equal_error"], ""),
        ("full step over latent step", report["speedup"]["latent_over_full"], ""),
        ("all stages", total_seconds(report), "s"),
    ]
    for space in ("linear", "latent"):
        for entry in report["simulate"][space]:
            error = entry["online_error"]
            values.append((f"online error, {space}, {entry['motion']}", error and error["relative"], ""))
            values.append((f"median step, {space}, {entry['motion']}", entry["median_step_ms"], "ms"))
    goals = GOALS if report["experiment"] == "x" else {}
    model = report["experiment"]
    return [row(model, name, value, unit, goals.get(name)) for name, value, unit in values]


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("runs", nargs="+", type=Path, help="folders of finished runs")
    folders: list[Path] = arguments.parse_args().runs
    reports = [json.loads((folder / "report" / "report.json").read_text()) for folder in folders]
    sizes = [sum(f.stat().st_size for f in folder.rglob("*") if f.is_file()) / 1e6 for folder in folders]
    print(size_table(reports, sizes), reconstruction_table(reports), cubature_table(reports), sep="\n")
    print(simulation_table(reports), cost_table(reports), sep="\n")
    rows = [entry for report in reports for entry in rows_of(report)]
    show([entry for entry in rows if entry["goal"] is not None], "Goals")
    inputs = [*ROOMS, *(f"configs/{report['experiment']}.yaml" for report in reports)]
    machine, created = reports[0]["machine"], reports[-1]["created"]
    write_results("pipeline", called(NAME), rows, machine, created, inputs)


if __name__ == "__main__":
    main()
