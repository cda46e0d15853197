"""`ldsim report`: write report.json, report.html, figures and pictures."""

from __future__ import annotations

import time

import click

from ldsim import run as runs
from ldsim.cli.stage import Run, peak_memory_mb, progress_bar, stage_command
from ldsim.jit import one_thread
from ldsim.report.report import Wanted, build_report, write_report


@stage_command("report", "Write report.json, report.html and figures.")
def command(run: Run) -> None:
    settings = run.settings
    wanted = Wanted(settings.report.pictures, settings.cubature.tolerance, settings.train.tolerance_mm)
    with runs.Run(run.folder, settings.experiment) as finished, one_thread():
        finished.require("scene", "snapshots", "basis", "model", "cubature", "simulation")
        with progress_bar(None, "report", "picture") as bar:
            report = build_report(finished, wanted, lambda: _cost(run), bar.update)
    folder = run.folder / "report"
    write_report(folder, report)
    seconds = time.perf_counter() - run.started
    click.echo(f"{folder}: {len(report.figures)} figures, {len(report.pictures)} pictures ({seconds:.1f} s)")
    click.echo(str((folder / "report.html").resolve()))


def _cost(run: Run) -> dict[str, float]:
    return {"seconds": time.perf_counter() - run.started, "peak_memory_mb": peak_memory_mb()}
