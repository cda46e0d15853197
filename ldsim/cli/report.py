"""`ldsim report`: write report.json, report.html, figures and pictures."""

from __future__ import annotations

import time

import click

from ldsim.artefacts.records import read_basis, read_cubature, read_model, read_scene
from ldsim.artefacts.simulation import read_simulation
from ldsim.artefacts.snapshots import Snapshots
from ldsim.cli.stage import Run, peak_memory_mb, progress_bar, stage_command
from ldsim.jit import one_thread
from ldsim.report.finished_run import FinishedRun
from ldsim.report.report import Wanted, build_report, write_report

# What each artefact is checked against: with the scene, a chain from the last stage to the first, so that the large
# files are hashed once.
CHECKED_INPUTS: dict[str, tuple[str, ...]] = {
    "scene": (),
    "snapshots": ("scene",),
    "basis": ("scene", "snapshots"),
    "model": ("basis",),
    "cubature": ("scene", "basis", "model"),
    "simulation": ("scene", "basis", "model", "cubature"),
}


@stage_command("report", "Write report.json, report.html and figures.")
def command(run: Run) -> None:
    settings = run.settings
    wanted = Wanted(settings.report.pictures, settings.cubature.tolerance, settings.train.tolerance_mm)
    scene, scene_header = read_scene(run.path("scene"))
    basis, basis_header = read_basis(run.path("basis"), scene)
    model, model_header = read_model(run.path("model"))
    cubature, cubature_header = read_cubature(run.path("cubature"))
    trajectories, simulation_header = read_simulation(run.path("simulation"))
    with Snapshots(run.path("snapshots")) as snapshots, one_thread():
        read = (scene_header, snapshots.header, basis_header, model_header, cubature_header, simulation_header)
        headers = {header.kind: header for header in read}
        for kind, inputs in CHECKED_INPUTS.items():
            run.check(kind, headers[kind], *inputs)
        finished = FinishedRun(settings.experiment, scene, snapshots, basis, model, cubature, trajectories, headers)
        with progress_bar(None, "report", "picture") as bar:
            report = build_report(finished, wanted, lambda: _cost(run), bar.update)
    folder = run.folder / "report"
    write_report(folder, report)
    seconds = time.perf_counter() - run.started
    click.echo(f"{folder}: {len(report.figures)} figures, {len(report.pictures)} pictures ({seconds:.1f} s)")
    click.echo(str((folder / "report.html").resolve()))


def _cost(run: Run) -> dict[str, float]:
    return {"seconds": time.perf_counter() - run.started, "peak_memory_mb": peak_memory_mb()}
