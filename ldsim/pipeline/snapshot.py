"""The stage snapshot: a scene and motions → their runs in the full space."""

from __future__ import annotations

from pathlib import Path

from ldsim.artefacts.partial import MotionStore, write_snapshots
from ldsim.artefacts.snapshots import Snapshots
from ldsim.dynamics.full.linear_choice import choose
from ldsim.pipeline.ensemble import run_motions
from ldsim.pipeline.motions import motion
from ldsim.pipeline.options import SnapshotOptions
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.run import Run


def snapshot(
    run: Run,
    options: SnapshotOptions,
    progress: Progress = SILENT,
    base: Path = Path(),
    scheduler: str | None = None,
) -> Snapshots:
    """Run every motion of a run in the full space, and write snapshots.h5; what was interrupted goes on where it was.

    Args:
        base: the folder to which the files of the options are relative.
        scheduler: address of a Dask scheduler that is running, such as tcp://host:8786; this machine where left out.

    Raises:
        LdsimError: a motion that cannot be made, a step that cannot be solved, workers that died; finished frames are
            kept.
    """
    stage, folder = run.stage("snapshot", options), run.folder / "snapshots.partial"
    run.require("scene")
    scene = run.scene
    motions = [motion(scene, entry, base) for entry in options.motions]
    workers = min(options.workers, len(motions))
    choice = choose(scene, options.linear_solver, workers)
    words = f"{options.method}, {'quasi-static' if options.quasistatic else 'dynamic'}, {choice.words}"
    progress.tell(f"full space: {words}")
    with progress.bar(f"snapshot {run.experiment}", sum(each.frames for each in motions), "frame") as bar:

        def show(done: int, unfinished: int) -> None:
            bar.say(f"{unfinished} motions to finish")
            bar.reach(done)

        solver = options.solver.model_copy(update={"linear_solver": choice.name})
        run_motions(run.path("scene"), folder, motions, solver, workers, show, scheduler)
    stores = [(MotionStore(folder, each), each, role) for each, role in zip(motions, options.roles, strict=True)]
    quasistatic = int(options.quasistatic)
    header = stage.header("snapshots", ("scene",), options.seed, solver=words, quasistatic=quasistatic)
    write_snapshots(run.path("snapshots"), header, stores, scene.mesh.n_vertices)
    run.written("snapshots")
    return run.snapshots
