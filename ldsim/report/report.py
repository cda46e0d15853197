"""The report of a finished run: its numbers, warnings, figures and pictures, and the folder that holds them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ldsim.artefacts.atomic import replacing_folder
from ldsim.artefacts.store import STAGE_OF
from ldsim.cubature.options import CubatureOptions
from ldsim.jit import one_thread
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.report.figure import Figure
from ldsim.report.figures import draw_figures
from ldsim.report.numbers import collect
from ldsim.report.options import ReportOptions
from ldsim.report.page import render_page
from ldsim.report.pictures import Picture, moving_picture
from ldsim.report.remedies import Facts, remedies
from ldsim.report.replay import make_replay
from ldsim.report.schema import RunNumbers
from ldsim.report.svg import drawn
from ldsim.report.verdict import verdict
from ldsim.report.warnings import warnings_of_numbers, warnings_of_run
from ldsim.run import Run


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
    picture: Picture | None


def report(run: Run, options: ReportOptions = ReportOptions(), progress: Progress = SILENT) -> Report:
    """The stage report: write the folder report/ of a run that has all its artefacts.

    Raises:
        ArtefactError: an artefact is missing or does not fit the others, or the folder cannot be written.
    """
    begun = run.stage("report", options)
    run.space("latent")  # a damaged file is named before the simulation that is stale for it
    run.require(*STAGE_OF, *(["tests"] if run.path("tests").is_file() else []))
    with one_thread(), progress.bar("report", None, "picture") as bar:
        made = build_report(run, options, lambda: begun.cost, bar.update)
    write_report(run.folder / "report", made)
    return made


def build_report(
    run: Run, options: ReportOptions, cost: Callable[[], Mapping[str, float]], progress: Callable[[], object]
) -> Report:
    """Collect, draw and lay out everything that there is to say about a run.

    Args:
        cost: seconds and peak_memory_mb so far; asked when all is drawn.
        progress: called when the animation is drawn.
    """
    tolerance = CubatureOptions.of_dump(run.header("cubature").settings).tolerance
    figures = {name: (figure, drawn(figure)) for name, figure in draw_figures(run, tolerance).items()}
    picture = moving_picture(run) if options.pictures else None
    progress()
    numbers = collect(run, options, cost())
    facts = Facts.of(run, numbers)
    warnings = [*warnings_of_numbers(numbers, tolerance), *warnings_of_run(run, facts.train.tolerance_mm)]
    found = {"verdict": verdict(numbers), "warnings": warnings, "remedies": remedies(facts)}
    numbers = numbers.model_copy(update=found)
    replay = make_replay(run) if options.pictures else None
    page = render_page(numbers, figures, picture, replay)
    return Report(numbers, page, figures, picture)


def write_report(folder: Path, report: Report) -> None:
    """Replace the folder of a report whole.

    Raises:
        ArtefactError: the folder cannot be written; what was there before is untouched.
    """
    with replacing_folder(folder) as new:
        for name in ("figures", "pictures"):
            (new / name).mkdir()
        for name, (figure, svg) in report.figures.items():
            (new / "figures" / f"{name}.svg").write_text(svg, encoding="utf-8")
            (new / "figures" / f"{name}.json").write_text(_json(figure.record()), encoding="utf-8")
        if report.picture is not None:
            (new / "pictures" / report.picture.file).write_bytes(report.picture.data)
        (new / "report.json").write_text(_json(report.numbers.model_dump()), encoding="utf-8")
        (new / "report.html").write_text(report.page, encoding="utf-8")


def _json(content: object) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
