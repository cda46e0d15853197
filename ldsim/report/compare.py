"""Several finished runs side by side: what is read of them, and one record each of the numbers that compare."""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ldsim.artefacts.atomic import replacing
from ldsim.errors import ArtefactError, ExportError
from ldsim.report import schema
from ldsim.report.compare_figures import comparison_figures
from ldsim.report.overview import PAGE, read_report
from ldsim.report.page import render
from ldsim.report.paper import paper_row
from ldsim.report.schema import ROLES, RunNumbers
from ldsim.report.svg import drawn
from ldsim.run import REDUCED, SPACES


def compare(folders: Sequence[Path], output: Path) -> list[str]:
    """Write the page of some runs to `output`, and its numbers to a .json beside it.

    Returns:
        The warnings of the page.

    Raises:
        ArtefactError: as `read_runs`, or a file cannot be written.
        ExportError: `output` is not the name of an HTML file.
    """
    if output.suffix != ".html" or output.is_dir():
        raise ExportError(f"the output is {output}; expected the name of a file that ends in .html")
    beside = output.with_suffix(".json")
    if beside.exists() and not _is_comparison(beside):
        raise ExportError(f"{beside}, which its numbers would replace, is no comparison; give another name")
    runs = read_runs(folders)
    content = comparison(runs, datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"), output.parent)
    page = comparison_page(runs, content)
    numbers = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    for path, text in ((beside, numbers), (output, page)):
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return list(content["warnings"])


def _is_comparison(path: Path) -> bool:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(found, dict) and {"runs", "warnings"} <= set(found)


def comparison_page(runs: Sequence[Reported], content: Mapping[str, Any]) -> str:
    """The page, which needs nothing from outside itself; `content` is the `comparison` of the same runs."""
    pairs = list(zip((run.report for run in runs), content["runs"], strict=True))
    folders = [str(run.folder) for run in runs]
    figures = {name: (figure, drawn(figure)) for name, figure in comparison_figures(content["runs"]).items()}
    return render("compare.html", figures, content=content, pairs=pairs, folders=folders)


@dataclass(frozen=True, eq=False)
class Reported:
    """A finished run as its report.json tells it.

    Attributes:
        name: what tells it from the others: its experiment, or its folder where two runs have the same experiment.
        folder: of the run.
        report: the content of report.json.
    """

    name: str
    folder: Path
    report: RunNumbers

    def link(self, start: Path) -> str:
        """From a page in the folder `start` to the run's own report, as an address."""
        page = self.folder / PAGE
        return quote(Path(os.path.relpath(page.resolve(), start.resolve())).as_posix())


def read_runs(folders: Sequence[Path]) -> list[Reported]:
    """The reports of some runs, in the order given.

    Raises:
        ArtefactError: a folder is none, or given twice; a report is missing, unreadable or of another version.
    """
    for folder in folders:
        if not folder.is_dir():
            raise ArtefactError(f"run folder {folder} does not exist or is no folder; expected one such as runs/demo")
    counts = Counter(folder.resolve() for folder in folders)
    for folder in folders:
        if counts[folder.resolve()] > 1:
            raise ArtefactError(f"the run {folder} is given {counts[folder.resolve()]} times; give each run once")
    reports = [read_report(folder) for folder in folders]
    names = Counter(report.experiment for report in reports)
    return [
        Reported(report.experiment if names[report.experiment] == 1 else str(folder), folder, report)
        for folder, report in zip(folders, reports, strict=True)
    ]


def record(run: Reported) -> dict[str, Any]:
    """The numbers of a run that compare, for compare.json and every table and figure of the page.

    Step times are those of the report's headline motion. Errors and novelty of a role are those of the motion of that
    role with the largest error, so that none is hidden; a motion whose run diverged is taken as such.
    """
    report = run.report
    headline = report.headline_runs()
    rules = {space: report.cubature[space] for space in REDUCED}
    theirs = paper_row(report.experiment)
    return {
        "name": run.name,
        "experiment": report.experiment,
        "cells": report.mesh.cells,
        "cell_type": report.mesh.cell_type,
        **report.dims.model_dump(),
        "points": {space: rule and rule.stepped for space, rule in rules.items()},
        "cubature_error": {
            space: rule.relative_error.model_dump() if rule else {"fitted": None, "kept_back": None}
            for space, rule in rules.items()
        },
        "motion": next((entry.motion for entry in headline.values()), None),
        "step_ms": {space: headline[space].median_step_ms if space in headline else None for space in SPACES},
        "speedup": report.speedup.model_dump(),
        "reconstruction_max_mm": {
            role: {method: _largest_mm(report, role, method) for method in ("autoencoder", "pca_kp")} for role in ROLES
        },
        "space": report.space,
        "kind": report.kind,
        "online": {role: {space: _worst(report.simulate[space], role) for space in REDUCED} for role in ROLES},
        "paper": None if theirs is None else theirs._asdict(),
    }


def _largest_mm(report: RunNumbers, role: str, method: str) -> float | None:
    errors = report.reconstruction[role] and report.reconstruction[role][method]
    return None if errors is None else errors.max_mm


def _worst(runs: Sequence[schema.MotionRun], role: str) -> dict[str, Any] | None:
    """The run with the largest online error among the motions of a role; None where none was run."""
    mine = [run for run in runs if run.role == role]
    if not mine:
        return None
    worst = max(mine, key=_badness)
    return {
        "motion": worst.motion,
        "diverged": worst.diverged,
        **_some(worst.online_error, "relative", "windowed"),
        **_some(worst.novelty, "share_above", "rank_correlation_remembered"),
    }


def _some(numbers: schema.OnlineError | schema.NoveltyNumbers | None, *keys: str) -> dict[str, float | None]:
    return {key: None if numbers is None else numbers[key] for key in keys}


def _badness(run: schema.MotionRun) -> float:
    """What the worst run has most of: infinite where it diverged, below all others where nothing was measured."""
    error = None if run.online_error is None else run.online_error.relative
    return math.inf if run.diverged else -1.0 if error is None else error


def warnings_of(runs: Sequence[Reported]) -> list[str]:
    """What a reader must know before the numbers: first what makes the runs hard to compare, then each run's own."""
    return [
        *_unlike(runs, "processors, so their step times do not compare", lambda m: f"{m.cpu}, {m.cores} cores"),
        *_unlike(runs, "versions of ldsim", lambda m: m.versions.get("ldsim", "unknown")),
        *(f"{run.name}: {warning}" for run in runs for warning in run.report.warnings),
    ]


def _unlike(runs: Sequence[Reported], what: str, of: Callable[[schema.MachineDescription], str]) -> list[str]:
    """One sentence where the runs' machines differ in something."""
    found: dict[str, list[str]] = {}
    for run in runs:
        found.setdefault(of(run.report.machine), []).append(run.name)
    listed = "; ".join(f"{value} ({', '.join(names)})" for value, names in found.items())
    return [f"The runs were reported on different {what}: {listed}."] if len(found) > 1 else []


def comparison(runs: Sequence[Reported], created: str, place: Path) -> dict[str, Any]:
    """The content of compare.json: when, warnings, and each run's record with the link to its report from `place`."""
    records = [record(run) | {"report": run.link(place)} for run in runs]
    return {"created": created, "warnings": warnings_of(runs), "runs": records}
