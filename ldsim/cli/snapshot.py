"""`ldsim snapshot`: run the motions in the full space."""

from __future__ import annotations

import click
import numpy as np

from ldsim.artefacts.records import read_scene
from ldsim.artefacts.snapshots import MotionStore, write_snapshots
from ldsim.cli.stage import Run, progress_bar, stage_command
from ldsim.dynamics.linear_choice import choose
from ldsim.ensemble import SolverOptions, run_motions
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.pulls import random_pulls
from ldsim.mechanics.recording import read_recording
from ldsim.mechanics.scene import Scene
from ldsim.mesh.surface import surface_vertices
from ldsim.settings import MotionSettings, resolve_path


@stage_command("snapshot", "Run the motions in the full space; interrupted, it goes on where it was.")
def command(run: Run) -> None:
    settings = run.settings.snapshot
    scene, header = read_scene(run.path("scene"))
    run.check("scene", header)
    motions = [_motion(run, scene, entry) for entry in settings.motions]
    folder = run.folder / "snapshots.partial"
    choice = choose(scene, settings.linear_solver, min(settings.workers, len(motions)))
    options = SolverOptions(
        settings.tolerance,
        settings.factor_cost,
        settings.max_iterations,
        settings.method,
        choice.name,
        settings.quasistatic,
    )
    solver = f"{settings.method}, {'quasi-static' if settings.quasistatic else 'dynamic'}, {choice.words}"
    click.echo(f"full space: {solver}", err=True)
    frames = sum(motion.frames for motion in motions)
    with progress_bar(frames, f"snapshot {run.settings.experiment}", "frame") as bar:

        def show(done: int, unfinished: int) -> None:
            bar.set_postfix_str(f"{unfinished} motions to finish")
            bar.update(done - bar.n)

        run_motions(run.path("scene"), folder, motions, options, settings.workers, show)
    stores = [
        (MotionStore(folder, motion), motion, entry.role)
        for motion, entry in zip(motions, settings.motions, strict=True)
    ]
    seeds = [entry.pulls.seed for entry in settings.motions if entry.pulls is not None]
    header = run.header("snapshots", "snapshot", ("scene",), seed=seeds[0] if seeds else -1, solver=solver)
    write_snapshots(run.path("snapshots"), header, stores, scene.mesh.n_vertices)
    run.done("snapshots", f"{frames} frames of {len(motions)} motions")


def _motion(run: Run, scene: Scene, settings: MotionSettings) -> Motion:
    if settings.recording is not None:
        return read_recording(resolve_path(settings.recording, run.config), settings.name, settings.frames)
    pulls = settings.pulls
    assert pulls is not None
    surface = surface_vertices(scene.mesh)
    movable = scene.mesh.vertices[np.intersect1d(surface, scene.free)]
    motion = random_pulls(
        settings.name,
        movable,
        pulls.count,
        pulls.seed,
        pulls.reach,
        pulls.stiffness,
        pulls.radius,
        pulls.frames,
        pulls.rest,
    )
    frames = min(settings.frames or motion.frames, motion.frames)
    return Motion(motion.name, frames, tuple(drag for drag in motion.drags if drag.start < frames))
