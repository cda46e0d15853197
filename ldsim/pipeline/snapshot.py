"""The stage snapshot: a scene and motions → their runs in the full space."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from ldsim.artefacts.partial import MotionStore, Stored, StoredBefore, write_snapshots
from ldsim.artefacts.snapshots import Snapshots
from ldsim.dynamics.full.linear_choice import choose
from ldsim.errors import ArtefactError
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.options import ScriptOptions
from ldsim.mechanics.random_pulls import surface_pulls
from ldsim.mechanics.recording import read_recording
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.script import released, scripted, swept
from ldsim.options import read_options
from ldsim.pipeline.ensemble import naming, run_identity, run_motions
from ldsim.pipeline.files import file_sums, resolve_path
from ldsim.pipeline.options import MotionOptions, SnapshotOptions
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.run import Run, Stage

KINDS = ("snapshots", "tests")


def snapshot(
    run: Run,
    options: SnapshotOptions,
    progress: Progress = SILENT,
    base: Path = Path(),
    scheduler: str | None = None,
) -> Snapshots:
    """Run every motion of a run in the full space; write snapshots.h5, and tests.h5 with the motions of the role test.

    What was interrupted goes on where it was. A motion that lies there already is kept, so that one that is added runs
    alone, and a file that already holds just what it is to hold is left as it is.

    Args:
        base: the folder to which the files of the options are relative.
        scheduler: address of a Dask scheduler that is running, such as tcp://host:8786; this machine where left out.

    Returns:
        All motions, those of the role test last.

    Raises:
        LdsimError: a motion that cannot be made, a step that cannot be solved, workers that died; finished frames are
            kept.
    """
    parts = dict(zip(KINDS, (options.learned, options.tests), strict=True))
    stages = {kind: run.stage("snapshot", part) for kind, part in parts.items()}
    run.require("scene")
    # of what is read now: what is replaced while the motions run makes stale what they are written into
    scene_hash, files = run.hash("scene"), {kind: file_sums(part.input_files, base) for kind, part in parts.items()}
    scene, folder = run.scene, run.folder / "snapshots.partial"
    motions = {entry.name: motion(scene, entry, base) for entry in options.motions}
    workers = min(options.workers, len(motions))
    choice = choose(scene, options.linear_solver, workers)
    words = f"{options.method}, {'quasi-static' if options.quasistatic else 'dynamic'}, {choice.words}"
    solver = options.solver.model_copy(update={"linear_solver": choice.name})
    identities = {name: run_identity(scene_hash, each, solver) for name, each in motions.items()}
    with ExitStack() as stack:
        there = {kind: found for kind in KINDS if (found := _there(run, kind, stack, progress)) is not None}
        kept = {name: found for found in there.values() for name in found.names}
        kept = {name: found for name, found in kept.items() if found.recorded(name).identity == identities.get(name)}
        missing = [each for name, each in motions.items() if name not in kept]
        if missing:
            progress.tell(f"full space: {words}")
            with progress.bar(f"snapshot {run.experiment}", sum(each.frames for each in missing), "frame") as bar:

                def show(done: int, unfinished: int) -> None:
                    bar.say(f"{unfinished} motions to finish")
                    bar.reach(done)

                run_motions(run.path("scene"), folder, missing, solver, min(workers, len(missing)), show, scheduler)
        gathering = _Gathering(run, motions, kept, words, files)
        # first what takes motions from the other one, which has them until it is replaced
        for kind, part in sorted(parts.items(), key=lambda each: -gathering.taken(each[1], there.get(each[0]))):
            gathering.write(kind, stages[kind], part, there.get(kind))
    return run.played


def _there(run: Run, kind: str, stack: ExitStack, progress: Progress) -> Snapshots | None:
    """What an earlier call has written; None where there is nothing, or nothing readable, of which is told."""
    try:
        return stack.enter_context(Snapshots(run.path(kind), run.scene.mesh.n_vertices, kind))
    except ArtefactError as error:
        if run.path(kind).exists():
            progress.tell(f"note: {error}; its motions run anew")
        return None


@dataclass(frozen=True)
class _Gathering:
    """The writing of the two artefacts.

    Attributes:
        motions: all, made for the scene.
        kept: name → where it lies already.
        words: how the full space was stepped.
        files: of each artefact the files that its options name, as `file_sums` has them.
    """

    run: Run
    motions: Mapping[str, Motion]
    kept: Mapping[str, Snapshots]
    words: str
    files: Mapping[str, str]

    def write(self, kind: str, stage: Stage, options: SnapshotOptions, there: Snapshots | None) -> None:
        """Write one of them, unless it is there with just these motions.

        Args:
            options: with the motions of this artefact alone.
        """
        run, names, earlier = self.run, [entry.name for entry in options.motions], 0.0
        made_from = options.dump(), run.hash("scene"), self.files[kind]
        if there is not None:
            mine = [name for name in names if self.kept.get(name) is there]
            header = there.header
            # artefacts of earlier versions do not say which files they were made from
            before = header.settings, header.inputs.get("scene"), header.notes.get("files", made_from[2])
            if before == made_from and mine == names == there.names:
                return
            earlier = float(there.header.notes.get("seconds", 0.0)) if mine else 0.0
        notes: dict[str, str | float | int] = {"solver": self.words, "quasistatic": int(options.quasistatic)}
        notes |= {"seconds": stage.seconds + earlier, "files": made_from[2]}
        header = stage.header(kind, ("scene",), options.seed, **notes)
        entries = [
            (self._stored(name), self.motions[name], role) for name, role in zip(names, options.roles, strict=True)
        ]
        write_snapshots(run.path(kind), header, entries, run.scene.mesh.n_vertices)
        run.written(kind)

    def taken(self, options: SnapshotOptions, there: Snapshots | None) -> int:
        """How many motions of an artefact lie in the other one."""
        return sum(self.kept.get(entry.name, there) is not there for entry in options.motions)

    def _stored(self, name: str) -> Stored:
        if name in self.kept:
            return StoredBefore(self.kept[name], name)
        return MotionStore(self.run.folder / "snapshots.partial", self.motions[name])


def motion(scene: Scene, options: MotionOptions, base: Path = Path()) -> Motion:
    """The motion that the options describe, for a scene.

    Args:
        base: the folder to which the files of the options are relative.

    Raises:
        LdsimError: naming the motion.
    """
    with naming(options.name):
        whole = _motion(scene, options, base)
    return whole if options.frames is None else whole.first(options.frames)


def _motion(scene: Scene, options: MotionOptions, base: Path) -> Motion:
    name = options.name
    if options.recording is not None:
        return read_recording(resolve_path(options.recording, base), name)
    if options.pulls is not None:
        return surface_pulls(name, scene, options.pulls)
    if options.script is not None:
        return scripted(name, scene, options.script)
    if options.script_file is not None:
        return scripted(name, scene, read_options(resolve_path(options.script_file, base), "script", ScriptOptions))
    if options.gravity_sweep is not None:
        return swept(name, scene, options.gravity_sweep)
    assert options.release is not None
    return released(name, scene, options.release)
