"""`ldsim snapshot`: run the motions in the full space."""

from __future__ import annotations

import click

from ldsim.artefacts.partial import MotionStore, write_snapshots
from ldsim.artefacts.records import read_scene
from ldsim.cli.motions import motion
from ldsim.cli.stage import Run, progress_bar, stage_command
from ldsim.dynamics.full.linear_choice import choose
from ldsim.dynamics.full.options import FullOptions
from ldsim.pipeline.ensemble import run_motions

SCHEDULER = click.Option(
    ["--scheduler"],
    metavar="ADDRESS",
    help="Dask scheduler to run on, tcp://host:8786, instead of this machine.",
)


@stage_command("snapshot", "Run the motions in the full space; interrupted, it goes on where it was.", SCHEDULER)
def command(run: Run, scheduler: str | None = None) -> None:
    settings = run.settings.snapshot
    scene, header = read_scene(run.path("scene"))
    run.check("scene", header)
    motions = [motion(run, scene, entry) for entry in settings.motions]
    folder = run.folder / "snapshots.partial"
    choice = choose(scene, settings.linear_solver, min(settings.workers, len(motions)))
    solver_options = FullOptions(**settings.model_dump(include=set(FullOptions.model_fields)))
    options = solver_options.model_copy(update={"linear_solver": choice.name})
    solver = f"{settings.method}, {'quasi-static' if settings.quasistatic else 'dynamic'}, {choice.words}"
    click.echo(f"full space: {solver}", err=True)
    frames = sum(each.frames for each in motions)
    with progress_bar(frames, f"snapshot {run.settings.experiment}", "frame") as bar:

        def show(done: int, unfinished: int) -> None:
            bar.set_postfix_str(f"{unfinished} motions to finish", refresh=False)
            bar.update(done - bar.n)

        run_motions(run.path("scene"), folder, motions, options, settings.workers, show, scheduler)
    stores = [(MotionStore(folder, each), each, role) for each, role in zip(motions, settings.roles, strict=True)]
    seeds = [entry.pulls.seed for entry in settings.motions if entry.pulls is not None]
    header = run.header("snapshots", "snapshot", ("scene",), seed=seeds[0] if seeds else -1, solver=solver)
    write_snapshots(run.path("snapshots"), header, stores, scene.mesh.n_vertices)
    run.done("snapshots", f"{frames} frames of {len(motions)} motions")
