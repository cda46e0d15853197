"""The report of a finished run: its numbers, warnings, figures and pictures, and the folder that holds them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.folder import replacing_folder
from ldsim.optimise.solution import Reason
from ldsim.report.cautions import cautions
from ldsim.report.errors import MM_PER_M
from ldsim.report.finished_run import FinishedRun
from ldsim.report.html import readable
from ldsim.report.page import render_page
from ldsim.report.replay import make_replay
from ldsim.report.report_figures import draw_figures
from ldsim.report.report_numbers import collect
from ldsim.report.report_pictures import Picture, take_pictures
from ldsim.report.report_schema import SPACES

# Pictures beyond this many bytes lie in the folder but not in the page, which base64 makes a third larger.
PAGE_PICTURE_BYTES = 3_000_000


@dataclass(frozen=True)
class Wanted:
    """What the settings say.

    Attributes:
        pictures: moments to show of each motion; 0 for none, and no replay either.
        cubature_tolerance: relative error asked of cubature.
        training_tolerance_mm: largest vertex error asked of the autoencoder, mm.
    """

    pictures: int
    cubature_tolerance: float
    training_tolerance_mm: float


@dataclass(frozen=True, eq=False)
class Report:
    """What the folder of a report holds.

    Attributes:
        numbers: the content of report.json.
        page: the content of report.html.
        figures: name → SVG text.
    """

    numbers: Mapping[str, Any]
    page: str
    figures: Mapping[str, str]
    pictures: Sequence[Picture]


def build_report(
    run: FinishedRun, wanted: Wanted, cost: Callable[[], Mapping[str, float]], progress: Callable[[], object]
) -> Report:
    """Collect, draw and lay out everything that there is to say about a run.

    Args:
        cost: seconds and peak_memory_mb so far; asked when all is drawn.
        progress: called after each picture.

    Raises:
        ValueError: the numbers break the contract of report.json, which would be a bug.
    """
    figures = draw_figures(run, wanted.cubature_tolerance)
    pictures = []
    for picture in take_pictures(run, wanted.pictures):
        progress()
        if picture is not None:
            pictures.append(picture)
    numbers = collect(run, cost())
    numbers["warnings"] = [
        *cautions(numbers, wanted.cubature_tolerance),
        *_missed_training_tolerance(run, wanted.training_tolerance_mm),
        *_unconverged_steps(run),
        *_changed_material(run),
    ]
    replay = make_replay(run) if wanted.pictures else None
    page = render_page(numbers, figures, _within_budget(pictures), numbers["warnings"], replay)
    return Report(numbers, page, figures, pictures)


def write_report(folder: Path, report: Report) -> None:
    """Replace the folder of a report whole; report.html is written last, because make looks at its time.

    Raises:
        ArtefactError: the folder cannot be written; what was there before is untouched.
    """
    with replacing_folder(folder) as new:
        for name in ("figures", "pictures"):
            (new / name).mkdir()
        for name, svg in report.figures.items():
            (new / "figures" / f"{name}.svg").write_text(svg, encoding="utf-8")
        for picture in report.pictures:
            (new / "pictures" / picture.file).write_bytes(picture.data)
        content = json.dumps(report.numbers, indent=2, ensure_ascii=False, allow_nan=False)
        (new / "report.json").write_text(content + "\n", encoding="utf-8")
        (new / "report.html").write_text(report.page, encoding="utf-8")


def _within_budget(pictures: Sequence[Picture]) -> dict[str, bytes]:
    """Caption → bytes of the pictures that keep the page small, from the first on."""
    sizes = np.cumsum([len(picture.data) for picture in pictures])
    return {
        picture.caption: picture.data
        for picture, size in zip(pictures, sizes, strict=True)
        if size <= PAGE_PICTURE_BYTES
    }


def _missed_training_tolerance(run: FinishedRun, tolerance_mm: float) -> list[str]:
    if int(run.headers["model"].notes.get("met", 1)):
        return []
    reached = MM_PER_M * float(run.model.errors[0, 0])
    return [
        f"The autoencoder misses training frames by up to {readable(reached)} mm; "
        f"{tolerance_mm:g} mm were asked for (train.tolerance_mm)."
    ]


def _changed_material(run: FinishedRun) -> list[str]:
    if not int(run.headers["simulation"].notes.get("material_changed", 0)):
        return []
    return [
        "The motions were simulated with another material than the snapshots have (simulate.material), so there is no "
        "full-space run to judge them by; basis, autoencoder and cubature are those of the old material."
    ]


def _unconverged_steps(run: FinishedRun) -> list[str]:
    """One sentence for each run with steps that stopped early; a run that diverged has its own warning."""
    found = [_unconverged("snapshots (full space)", name, recorded.reason) for name, recorded in run.recorded.items()]
    for space in SPACES:
        for name, trajectory in run.runs(space).items():
            if not trajectory.diverged:
                found.append(_unconverged(f"{space} run", name, trajectory.reason))
    return [sentence for sentence in found if sentence]


def _unconverged(what: str, motion: str, reason: NDArray[np.int64]) -> str:
    failed = reason[reason != Reason.CONVERGED]
    if len(failed) == 0:
        return ""
    commonest = Reason(int(np.bincount(failed).argmax())).words
    return f"In the {what} of motion {motion}, {len(failed)} of {len(reason)} steps did not converge ({commonest})."
