"""The report of a finished run: its numbers, warnings, figures and pictures, and the folder that holds them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ldsim.artefacts.folder import replacing_folder
from ldsim.artefacts.store import STAGE_OF
from ldsim.jit import one_thread
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.report.figure import Figure
from ldsim.report.figures import draw_figures
from ldsim.report.numbers import collect
from ldsim.report.options import ReportOptions
from ldsim.report.page import render_page
from ldsim.report.pictures import Picture, take_pictures
from ldsim.report.remedies import Facts, remedies
from ldsim.report.replay import make_replay
from ldsim.report.schema import RunNumbers
from ldsim.report.svg import drawn
from ldsim.report.warnings import warnings_of_numbers, warnings_of_run
from ldsim.run import Run

# Pictures beyond this many bytes lie in the folder but not in the page, which base64 makes a third larger.
PAGE_PICTURE_BYTES = 3_000_000


@dataclass(frozen=True)
class Wanted:
    """What the settings say.

    Attributes:
        pictures: moments to show of each motion; 0 for none, and no replay either.
        cubature_tolerance: relative error asked of cubature.
        training_tolerance_mm: largest vertex error asked of the latent space, mm.
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
        figures: name → figure, and its SVG.
    """

    numbers: RunNumbers
    page: str
    figures: Mapping[str, tuple[Figure, str]]
    pictures: Sequence[Picture]


def report(run: Run, wanted: Wanted, progress: Progress = SILENT) -> Report:
    """The stage report: write the folder report/ of a run that has all its artefacts.

    Raises:
        ArtefactError: an artefact is missing or does not fit the others, or the folder cannot be written.
    """
    begun = run.stage("report", ReportOptions(pictures=wanted.pictures))
    run.space("latent")  # a damaged file is named before the simulation that is stale for it
    run.require(*STAGE_OF, *(["tests"] if run.path("tests").is_file() else []))
    with one_thread(), progress.bar("report", None, "picture") as bar:
        made = build_report(run, wanted, lambda: begun.cost, bar.update)
    write_report(run.folder / "report", made)
    return made


def build_report(
    run: Run, wanted: Wanted, cost: Callable[[], Mapping[str, float]], progress: Callable[[], object]
) -> Report:
    """Collect, draw and lay out everything that there is to say about a run.

    Args:
        cost: seconds and peak_memory_mb so far; asked when all is drawn.
        progress: called after each picture.
    """
    figures = {name: (figure, drawn(figure)) for name, figure in draw_figures(run, wanted.cubature_tolerance).items()}
    pictures = []
    for picture in take_pictures(run, wanted.pictures):
        progress()
        if picture is not None:
            pictures.append(picture)
    numbers = collect(run, ReportOptions(pictures=wanted.pictures), cost())
    warnings = [
        *warnings_of_numbers(numbers, wanted.cubature_tolerance),
        *warnings_of_run(run, wanted.training_tolerance_mm),
    ]
    numbers = numbers.model_copy(update={"warnings": warnings, "remedies": remedies(Facts.of(run, numbers))})
    replay = make_replay(run) if wanted.pictures else None
    page = render_page(numbers, figures, _within_budget(pictures), replay)
    return Report(numbers, page, figures, pictures)


def write_report(folder: Path, report: Report) -> None:
    """Replace the folder of a report whole; report.html is written last, because make looks at its time.

    Raises:
        ArtefactError: the folder cannot be written; what was there before is untouched.
    """
    with replacing_folder(folder) as new:
        for name in ("figures", "pictures"):
            (new / name).mkdir()
        for name, (figure, svg) in report.figures.items():
            (new / "figures" / f"{name}.svg").write_text(svg, encoding="utf-8")
            (new / "figures" / f"{name}.json").write_text(_json(figure.record()), encoding="utf-8")
        for picture in report.pictures:
            (new / "pictures" / picture.file).write_bytes(picture.data)
        (new / "report.json").write_text(_json(report.numbers.model_dump()), encoding="utf-8")
        (new / "report.html").write_text(report.page, encoding="utf-8")


def _json(content: object) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _within_budget(pictures: Sequence[Picture]) -> dict[str, bytes]:
    """Caption → bytes of the pictures that keep the page small, from the first on."""
    sizes = np.cumsum([len(picture.data) for picture in pictures])
    return {
        picture.caption: picture.data
        for picture, size in zip(pictures, sizes, strict=True)
        if size <= PAGE_PICTURE_BYTES
    }
