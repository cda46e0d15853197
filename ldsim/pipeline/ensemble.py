"""Full-space runs of many motions, side by side, each resumable at its last checkpoint.

Motions are independent, so each is a task of its own process, run with one thread. A task appends its frames to a file
and replaces a checkpoint now and then. Whoever is interrupted, or takes over from a worker that died, goes on from
that and repeats an undisturbed run exactly, because the checkpoint holds all that the next step depends on.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from pathlib import Path

import numpy as np

from ldsim.artefacts.partial import Checkpoint, Lease, MotionStore
from ldsim.artefacts.records import read_scene
from ldsim.artefacts.snapshots import STATISTICS, motion_arrays
from ldsim.artefacts.store import file_hash
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullState, FullStepper, none_lost
from ldsim.dynamics.simulate import simulate
from ldsim.errors import ArtefactError, LdsimError, LostMotionError, SolverError
from ldsim.jit import one_thread
from ldsim.mechanics.motion import Motion
from ldsim.pipeline.cluster import WorkerDied, result, started

POLL_SECONDS = 0.5
# Between two checkpoints of a motion: of a small solid one takes longer than a step.
CHECKPOINT_SECONDS = 0.2


def run_motions(
    scene_path: Path,
    folder: Path,
    motions: Sequence[Motion],
    options: FullOptions,
    workers: int,
    progress: Callable[[int, int], None],
    scheduler: str | None = None,
    going_on: bool = False,
) -> dict[str, str]:
    """Run every motion to its end, continuing what an earlier call had begun.

    Args:
        folder: where the partial files lie.
        workers: processes on this machine, where no scheduler is given.
        progress: called now and then with the frames done and the motions still to finish.
        scheduler: address of a Dask scheduler whose workers see the files at the same paths.
        going_on: whether a motion of which a step has no solution ends alone.

    Returns:
        Name → what was wrong, of the motions that ended so.

    Raises:
        LdsimError: of the first motion that failed, which is named, or the scheduler cannot be reached; the others
            stop too, and the frames of all are kept.
    """
    scene_path, folder = scene_path.resolve(), folder.resolve()
    scene_hash = file_hash(scene_path)
    n_vertices = read_scene(scene_path)[0].mesh.n_vertices
    stores = [MotionStore(folder, motion) for motion in motions]
    waiting = sorted(motions, key=lambda motion: -motion.frames)

    def show() -> None:
        progress(sum(store.frames_written(n_vertices * 12) for store in stores), len(waiting))

    deaths, lost = 0, {}
    while waiting:
        with started(min(workers, len(waiting)), scheduler) as found:
            before, lease = len(waiting), Lease.taken(folder)
            try:
                tasks = {
                    found.pool.submit(run_motion, scene_path, lease, motion, options, scene_hash): motion
                    for motion in waiting
                }
                for future in _finished(tasks, show):
                    try:
                        result(future, found.died)
                    except LostMotionError as error:
                        if not going_on:
                            raise
                        lost[tasks[future].name] = str(error)
                    waiting.remove(tasks[future])
                    show()
            except WorkerDied:
                deaths = 1 if len(waiting) < before else deaths + 1
                if deaths >= found.tries:
                    raise
            finally:
                lease.given_back()
    return lost


def _finished(tasks: Iterable[Future[None]], show: Callable[[], None]) -> Iterator[Future[None]]:
    """Each task as it ends; now and then it is shown how far all are."""
    pending = set(tasks)
    while pending:
        done, pending = wait(pending, timeout=POLL_SECONDS, return_when=FIRST_COMPLETED)
        show()
        yield from done


def run_motion(scene_path: Path, lease: Lease, motion: Motion, options: FullOptions, scene_hash: str) -> None:
    """Run one motion from rest or from its checkpoint to its end, in the process of a worker.

    Args:
        scene_hash: SHA-256 of the scene that it is to run on.

    Raises:
        ArtefactError: the scene is another one by now.
        SolverError: the worker does not see the folder of the run, or another run took it over.
        LdsimError: of a frame, naming the motion.
    """
    if lease.taken_over:
        raise SolverError(f"{lease.folder} was taken over by another run; this one stopped")
    if not lease.holds():
        raise SolverError(
            f"the worker on {socket.gethostname()} does not see {lease.folder} as it is here; all workers need the "
            "folder of --runs at the same path, on a disk that they share"
        )
    store = MotionStore(lease.folder, motion)
    with one_thread(), store.owned():
        scene, _ = read_scene(scene_path)
        if file_hash(scene_path) != scene_hash:
            raise ArtefactError(f"{scene_path} changed while motions ran on it; run the stage again")
        identity = run_identity(scene_hash, motion, options)
        stepper = FullStepper(scene, options)
        checkpoint = store.read_checkpoint(identity, scene.mesh.n_vertices * 12)
        if checkpoint is None:
            store.start()
            none = np.empty(0, dtype=np.int64)
            checkpoint = Checkpoint(identity, vars(stepper.rest()), {}, dict.fromkeys(STATISTICS, none), np.empty(0))
        statistics = {name: list(values) for name, values in checkpoint.statistics.items()}
        seconds, written = list(checkpoint.seconds), -math.inf
        frames = range(checkpoint.frames, motion.frames)
        started = time.perf_counter()
        made = simulate(stepper, motion, FullState(**checkpoint.state), frames, checkpoint.held)
        with naming(motion.name):
            for frame in none_lost(stepper, made):
                seconds.append(time.perf_counter() - started)
                for name, values in statistics.items():
                    values.append(int(getattr(frame.solution, name)))
                store.append(frame.state.u)
                if len(seconds) == motion.frames or time.perf_counter() - written >= CHECKPOINT_SECONDS:
                    counts = {name: np.array(values, dtype=np.int64) for name, values in statistics.items()}
                    state = vars(frame.state)
                    store.write_checkpoint(Checkpoint(identity, state, frame.held, counts, np.array(seconds)))
                    written = time.perf_counter()
                if not lease.holds():
                    raise SolverError(f"{lease.folder} was taken over by another run; this one stopped")
                started = time.perf_counter()


@contextlib.contextmanager
def naming(motion: str) -> Iterator[None]:
    """Put the name of a motion in front of what is wrong with it."""
    try:
        yield
    except LdsimError as error:
        raise type(error)(f"motion {motion}: {error}") from error


def run_identity(scene_hash: str, motion: Motion, options: FullOptions) -> str:
    """SHA-256 of all that a run depends on; how its linear systems are solved is left out: memory may choose that."""
    digest = hashlib.sha256(scene_hash.encode())
    digest.update(repr((motion.name, motion.frames, options.replace(linear_solver="auto"))).encode())
    for name, values in motion_arrays(motion, {}).items():
        digest.update(name.encode() + values.tobytes())
    return digest.hexdigest()
