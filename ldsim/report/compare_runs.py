"""Several finished runs side by side: what is read of them, and one record each of the numbers that compare."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ldsim.errors import ArtefactError
from ldsim.report.paper import paper_row
from ldsim.report.report_schema import ROLES, SPACES, check_report
from ldsim.report.sections import headline_runs

REDUCED = ("linear", "latent")


@dataclass(frozen=True, eq=False)
class Reported:
    """A finished run as its report.json tells it.

    Attributes:
        name: what tells it from the others: its experiment, or its folder where two runs have the same experiment.
        folder: of the run.
        report: the content of report.json, which keeps the contract.
    """

    name: str
    folder: Path
    report: Mapping[str, Any]

    @property
    def page(self) -> Path:
        """Where its own report lies."""
        return self.folder / "report" / "report.html"


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
    reports = [_read(folder) for folder in folders]
    names = Counter(report["experiment"] for report in reports)
    return [
        Reported(report["experiment"] if names[report["experiment"]] == 1 else str(folder), folder, report)
        for folder, report in zip(folders, reports, strict=True)
    ]


def _read(folder: Path) -> dict[str, Any]:
    path = folder / "report" / "report.json"
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ArtefactError(f"{path} does not exist; run `ldsim report CONFIG` of that run first") from error
    except (OSError, ValueError) as error:
        raise ArtefactError(f"{path} cannot be read: {error}; run `ldsim report CONFIG` of that run again") from error
    violations = check_report(report)
    if violations:
        more = f" (and {len(violations) - 1} more)" if len(violations) > 1 else ""
        raise ArtefactError(
            f"{path} is not what this version of ldsim writes: {violations[0]}{more}; "
            "run `ldsim report CONFIG` of that run again"
        )
    checked: dict[str, Any] = report
    return checked


def record(run: Reported) -> dict[str, Any]:
    """The numbers of a run that compare, for compare.json and every table and figure of the page.

    Step times are those of the report's headline motion. Errors and trust of a role are those of the motion of that
    role with the largest error, so that none is hidden; a motion whose run diverged is taken as such.
    """
    report = run.report
    headline = headline_runs(report)
    theirs = paper_row(report["experiment"])
    return {
        "name": run.name,
        "experiment": report["experiment"],
        "cells": report["mesh"]["cells"],
        "cell_type": report["mesh"]["cell_type"],
        **report["dims"],
        "points": {space: (report["cubature"][space] or {}).get("points") for space in REDUCED},
        "cubature_error": {
            space: (report["cubature"][space] or {}).get("relative_error") or dict.fromkeys(ROLES) for space in REDUCED
        },
        "motion": next((entry["motion"] for entry in headline.values()), None),
        "step_ms": {space: (headline.get(space) or {}).get("median_step_ms") for space in SPACES},
        "speedup": report["speedup"],
        "reconstruction_max_mm": {
            role: {
                method: ((report["reconstruction"][role] or {}).get(method) or {}).get("max_mm")
                for method in ("autoencoder", "pca_kp")
            }
            for role in ROLES
        },
        "online": {role: {space: _worst(report["simulate"][space], role) for space in REDUCED} for role in ROLES},
        "paper": None if theirs is None else asdict(theirs),
    }


def _worst(runs: Sequence[Mapping[str, Any]], role: str) -> dict[str, Any] | None:
    """The run with the largest online error among the motions of a role; None where none was run."""
    mine = [run for run in runs if run["role"] == role]
    if not mine:
        return None
    worst = max(mine, key=_badness)
    error = worst["online_error"] or {"relative": None, "windowed": None}
    trust = worst["trust"] or {"distrusted": None, "rank_correlation_remembered": None}
    return {
        "motion": worst["motion"],
        "diverged": worst["diverged"],
        **{key: error[key] for key in ("relative", "windowed")},
        **{key: trust[key] for key in ("distrusted", "rank_correlation_remembered")},
    }


def _badness(run: Mapping[str, Any]) -> float:
    """What the worst run has most of: infinite where it diverged, below all others where nothing was measured."""
    error = (run["online_error"] or {}).get("relative")
    return math.inf if run["diverged"] else -1.0 if error is None else error


def warnings_of(runs: Sequence[Reported]) -> list[str]:
    """What a reader must know before the numbers: first what makes the runs hard to compare, then each run's own."""
    return [
        *_unlike(runs, "processors, so their step times do not compare", _processor),
        *_unlike(runs, "versions of ldsim", _version),
        *(f"{run.name}: {warning}" for run in runs for warning in run.report["warnings"]),
    ]


def _processor(machine: Mapping[str, Any]) -> str:
    return f"{machine['cpu']}, {machine['cores']} cores"


def _version(machine: Mapping[str, Any]) -> str:
    return str(machine["versions"].get("ldsim", "unknown"))


def _unlike(runs: Sequence[Reported], what: str, of: Callable[[Mapping[str, Any]], str]) -> list[str]:
    """One sentence where the runs' machines differ in something."""
    found: dict[str, list[str]] = {}
    for run in runs:
        found.setdefault(of(run.report["machine"]), []).append(run.name)
    listed = "; ".join(f"{value} ({', '.join(names)})" for value, names in found.items())
    return [f"The runs were reported on different {what}: {listed}."] if len(found) > 1 else []


def comparison(runs: Sequence[Reported], created: str, links: Sequence[str]) -> dict[str, Any]:
    """The content of compare.json: when, warnings, and each run's record with the link to its report."""
    records = [record(run) | {"report": link} for run, link in zip(runs, links, strict=True)]
    return {"created": created, "warnings": warnings_of(runs), "runs": records}
