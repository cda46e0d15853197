"""Motions side by side: whoever is killed goes on where it was, and nobody sees a difference."""

from __future__ import annotations

import contextlib
import copy
import itertools
import logging
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import psutil
import pytest
import yaml
from distributed import Client, LocalCluster
from distributed.scheduler import KilledWorker
from numpy.typing import NDArray

from ldsim.artefacts.partial import Checkpoint, Lease, MotionStore
from ldsim.artefacts.records import read_scene
from ldsim.artefacts.snapshots import Snapshots
from ldsim.artefacts.store import file_hash
from ldsim.dynamics.full.options import FullOptions
from ldsim.errors import ArtefactError, LostMotionError, MotionError, SolverError
from ldsim.mechanics.motion import Drag, Motion
from ldsim.pipeline import ensemble
from ldsim.pipeline.cluster import Workers, result
from ldsim.pipeline.ensemble import run_motion, run_motions
from tests.cli.experiments import TINY, Experiment
from tests.helpers import WAIT, changed, wait_until
from tests.pipeline.two_tets import made, run_here

FRAMES = 1000
MOTIONS = ("a", "b")
SOLVER = FullOptions()


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two motions, long enough to be killed in the middle, and their scene in two folders, undisturbed and killed."""
    folder = tmp_path_factory.mktemp("ensemble")
    content = copy.deepcopy(TINY)
    pulls = {"count": FRAMES // 20, "reach": 0.08, "frames": 12, "rest": 8}
    content["snapshot"] = {"motions": [{"name": name, "pulls": pulls | {"seed": i}} for i, name in enumerate(MOTIONS)]}
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    subprocess.run([*ldsim("mesh", path), "--runs", str(folder / "undisturbed")], check=True, capture_output=True)
    subprocess.run([*ldsim("snapshot", path), "--runs", str(folder / "undisturbed")], check=True, capture_output=True)
    return path


def ldsim(command: str, config: Path) -> list[str]:
    return [sys.executable, "-m", "ldsim", command, str(config)]


def seconds_so_far(folder: Path, name: str) -> NDArray[np.float64]:
    """The wall times of the frames that a checkpoint holds; no two runs have the same."""
    with h5py.File(folder / f"{name}.checkpoint.h5", "r") as file:
        times: NDArray[np.float64] = file["seconds"][:]
        return times


def group_is_gone(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


def kill_group(process: subprocess.Popen[bytes]) -> None:
    os.killpg(process.pid, signal.SIGKILL)


def kill_parent(process: subprocess.Popen[bytes]) -> None:
    os.kill(process.pid, signal.SIGKILL)


def interrupt_group(process: subprocess.Popen[bytes]) -> None:
    """What Ctrl-C does."""
    os.killpg(process.pid, signal.SIGINT)


def heed_interrupts() -> None:
    """A shell starts background jobs, and so perhaps these tests, with SIGINT ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def terminate_parent(process: subprocess.Popen[bytes]) -> None:
    os.kill(process.pid, signal.SIGTERM)


@pytest.mark.parametrize("kill", [kill_group, kill_parent, interrupt_group, terminate_parent])
def test_a_killed_run_goes_on_where_it_was_and_ends_as_an_undisturbed_one(
    config: Path, tmp_path: Path, kill: Callable[[subprocess.Popen[bytes]], None]
) -> None:
    undisturbed, run = config.parent / "undisturbed" / "tiny", tmp_path / "tiny"
    run.mkdir()
    (run / "scene.h5").write_bytes((undisturbed / "scene.h5").read_bytes())
    partial, command = run / "snapshots.partial", [*ldsim("snapshot", config), "--runs", str(tmp_path)]
    frame_bytes = read_scene(run / "scene.h5")[0].mesh.n_vertices * 12

    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, start_new_session=True, preexec_fn=heed_interrupts, **quiet) as first:
        try:
            for name in MOTIONS:
                path = partial / f"{name}.frames"
                wait_until(lambda path=path: path.exists() and path.stat().st_size > 20 * frame_bytes)
            kill(first)
            _, stderr = first.communicate(timeout=WAIT)
            wait_until(lambda: group_is_gone(first.pid))
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(first.pid, signal.SIGKILL)
    assert b"Traceback" not in stderr

    reached = {name: seconds_so_far(partial, name) for name in MOTIONS}
    for times in reached.values():
        assert 0 < len(times) < FRAMES
    subprocess.run(command, check=True, capture_output=True)
    assert not list(partial.glob("*"))

    with Snapshots(run / "snapshots.h5") as resumed, Snapshots(undisturbed / "snapshots.h5") as whole:
        assert resumed.names == whole.names
        for name in MOTIONS:
            a, b = resumed.recorded(name), whole.recorded(name)
            assert np.array_equal(resumed.reader(name)(0, FRAMES), whole.reader(name)(0, FRAMES))
            assert np.array_equal(a.iterations, b.iterations)
            assert np.array_equal(a.evaluations, b.evaluations)
            assert {i: v.tolist() for i, v in a.held.items()} == {i: v.tolist() for i, v in b.held.items()}
            assert np.array_equal(a.seconds[: len(reached[name])], reached[name])


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene of a few dozen cells."""
    experiment = Experiment(tmp_path_factory.mktemp("scene"))
    experiment.configure(TINY)
    assert experiment.invoke("mesh").exit_code == 0
    return experiment.run / "scene.h5"


def still(name: str, frames: int) -> Motion:
    """A motion without a grab: the solid sags and swings."""
    return Motion(name, frames, ())


def far_off(name: str) -> Motion:
    """A motion whose grab hits nothing."""
    return Motion(name, 3, (Drag(0, np.full(3, 9.0), np.full((3, 3), 9.0), 0.03, 30.0, at_rest=True),))


def frames_of(path: Path) -> int:
    with h5py.File(path, "r") as file:
        return len(file["seconds"])


def test_a_checkpoint_is_written_now_and_then_and_at_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a small solid it takes longer than a step."""
    written, write = list[int](), MotionStore.write_checkpoint

    def noted(store: MotionStore, checkpoint: Checkpoint) -> None:
        written.append(checkpoint.frames)
        write(store, checkpoint)

    monkeypatch.setattr(MotionStore, "write_checkpoint", noted)
    monkeypatch.setattr(ensemble, "time", SimpleNamespace(perf_counter=lambda: 0.0))
    run = made(tmp_path)
    run_here(run.path("scene"), tmp_path / "partial", [still("m", 30)], SOLVER)
    assert written == [1, 30]
    ticks = itertools.count(step=0.4 * ensemble.CHECKPOINT_SECONDS)
    monkeypatch.setattr(ensemble, "time", SimpleNamespace(perf_counter=lambda: next(ticks)))
    run_here(run.path("scene"), tmp_path / "partial", [still("n", 30)], SOLVER)
    assert written[-1] == 30 and len(written) > 2 + 5


def test_motions_that_share_a_scene_do_not_share_anything_else(scene: Path, tmp_path: Path) -> None:
    for folder, names in (("alone", ["m"]), ("beside", ["l", "m", "n"])):
        motions = [still(name, 10) for name in names]
        run_motions(scene, tmp_path / folder, motions, SOLVER, 2, lambda *_: None)
    assert (tmp_path / "alone" / "m.frames").read_bytes() == (tmp_path / "beside" / "m.frames").read_bytes()
    assert (tmp_path / "alone" / "m.frames").read_bytes() == (tmp_path / "beside" / "l.frames").read_bytes()


def test_a_motion_that_the_full_space_loses_ends_alone_where_the_others_go_on(scene: Path, tmp_path: Path) -> None:
    tip = max(read_scene(scene)[0].mesh.vertices, key=lambda vertex: vertex[1])
    far = Drag(0, tip, np.full((10, 3), -20.0), 0.03, 1e3, at_rest=True)
    motions = [Motion("far", 10, (far,)), still("good", 10)]
    with pytest.raises(LostMotionError, match="^motion far: frame"):
        run_motions(scene, tmp_path / "stopped", motions, SOLVER, 1, lambda *_: None)
    lost = run_motions(scene, tmp_path / "gone_on", motions, SOLVER, 1, lambda *_: None, going_on=True)
    assert list(lost) == ["far"] and lost["far"].startswith("motion far: frame ")
    assert frames_of(tmp_path / "gone_on" / "good.checkpoint.h5") == 10
    with pytest.raises(MotionError, match="^motion bad: the grab at frame 0 hits no vertex"):
        run_motions(scene, tmp_path / "bad", [far_off("bad")], SOLVER, 1, lambda *_: None, going_on=True)


def test_a_motion_that_fails_is_told_and_the_frames_of_the_others_are_kept(scene: Path, tmp_path: Path) -> None:
    motions = [still("good", 10), far_off("bad")]
    with pytest.raises(MotionError, match="^motion bad: the grab at frame 0 hits no vertex"):
        run_motions(scene, tmp_path, motions, SOLVER, 1, lambda *_: None)
    assert frames_of(tmp_path / "good.checkpoint.h5") == 10


def test_a_scene_that_is_replaced_while_its_motions_run_is_told(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A motion that starts late would run on another solid than those before it, into the same file."""
    own = tmp_path / "scene.h5"
    own.write_bytes(scene.read_bytes())
    started = ensemble.started

    def replacing_it(workers: int, scheduler: str | None) -> contextlib.AbstractContextManager[Workers]:
        with changed(own) as file:
            file.attrs["experiment"] = "another"
        return started(workers, scheduler)

    monkeypatch.setattr(ensemble, "started", replacing_it)
    with pytest.raises(ArtefactError, match=r"scene\.h5 changed while motions ran on it; run the stage again"):
        run_motions(own, tmp_path / "partial", [still("m", 3)], SOLVER, 1, lambda *_: None)
    assert not (tmp_path / "partial" / "m.frames").exists()


@pytest.mark.parametrize(
    "options", [FullOptions(tolerance=1e-5), FullOptions(factor_cost=20)], ids=["tolerance", "cost of a factor"]
)
def test_other_settings_start_anew(scene: Path, tmp_path: Path, options: FullOptions) -> None:
    run_motions(scene, tmp_path, [still("m", 6)], SOLVER, 1, lambda *_: None)
    first = seconds_so_far(tmp_path, "m")
    run_motions(scene, tmp_path, [still("m", 6)], SOLVER, 1, lambda *_: None)
    assert np.array_equal(seconds_so_far(tmp_path, "m"), first)
    run_motions(scene, tmp_path, [still("m", 6)], options, 1, lambda *_: None)
    assert not np.array_equal(seconds_so_far(tmp_path, "m"), first)


def test_progress_ends_with_all_frames_and_nothing_unfinished(scene: Path, tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    motions = [still("m", 6), still("n", 4)]
    run_motions(scene, tmp_path, motions, SOLVER, 1, lambda *call: calls.append(call))
    assert calls[-1] == (10, 0)
    assert calls == sorted(calls, key=lambda call: call[0])


def workers() -> list[psutil.Process]:
    """The processes of clusters that this one started."""
    return [child for child in psutil.Process().children() if "spawn_main" in " ".join(command(child))]


def command(process: psutil.Process) -> list[str]:
    """Its words; none of one that has just ended."""
    try:
        return process.cmdline()
    except psutil.Error:  # a zombie has none, and one that was waited for is nowhere
        return []


def test_a_worker_that_is_killed_costs_nothing_but_the_frames_since_its_checkpoint(scene: Path, tmp_path: Path) -> None:
    """The frames are those of an undisturbed run, and the worker that took over went on where the first one was."""
    run_motions(scene, tmp_path / "undisturbed", [still("m", 4 * FRAMES)], SOLVER, 1, lambda *_: None)
    others, reached = set(workers()), list[NDArray[np.float64]]()

    def kill_once(done: int, unfinished: int) -> None:
        if done >= 20 and not reached:
            (worker,) = set(workers()) - others
            worker.kill()
            worker.wait(WAIT)
            reached.append(seconds_so_far(tmp_path / "killed", "m"))

    run_motions(scene, tmp_path / "killed", [still("m", 4 * FRAMES)], SOLVER, 1, kill_once)
    assert 1 <= len(reached[0]) < 4 * FRAMES
    assert np.array_equal(seconds_so_far(tmp_path / "killed", "m")[: len(reached[0])], reached[0])
    assert (tmp_path / "killed" / "m.frames").read_bytes() == (tmp_path / "undisturbed" / "m.frames").read_bytes()


def test_no_process_of_a_run_listens_on_a_port(scene: Path, tmp_path: Path) -> None:
    """Whoever reached the port of the Dask cluster that there was before could run code as the user."""
    seen = set[str]()

    def look(done: int, unfinished: int) -> None:
        for process in [psutil.Process(), *psutil.Process().children(recursive=True)]:
            with contextlib.suppress(psutil.NoSuchProcess):
                seen.add("a process")
                seen.update(str(each.laddr) for each in process.net_connections("inet") if each.status == "LISTEN")

    before = {str(each.laddr) for each in psutil.Process().net_connections("inet") if each.status == "LISTEN"}
    run_motions(scene, tmp_path, [still("m", 200), still("n", 200)], SOLVER, 2, look)
    assert seen - before == {"a process"}


def test_a_run_that_was_taken_over_before_it_began_says_so(scene: Path, tmp_path: Path) -> None:
    lease = Lease.taken(tmp_path)
    Lease.taken(tmp_path)
    with pytest.raises(SolverError, match="was taken over by another run"):
        run_motion(scene, lease, still("m", 2), SOLVER, file_hash(scene))


def test_a_motion_whose_worker_dies_again_and_again_is_told(scene: Path, tmp_path: Path) -> None:
    others, killed = set(workers()), list[int]()

    def kill_all(done: int, unfinished: int) -> None:
        for worker in set(workers()) - others:
            worker.kill()
            killed.append(worker.pid)

    with pytest.raises(SolverError, match="died again and again on one motion"):
        run_motions(scene, tmp_path, [still("m", 100_000)], SOLVER, 1, kill_all)
    assert len(set(killed)) == 3


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    """A cluster that somebody else started."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cluster = LocalCluster(
            n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address=":0", silence_logs=logging.CRITICAL
        )
    with cluster:
        yield cluster


def test_an_existing_cluster_makes_the_same_frames(scene: Path, tmp_path: Path, cluster: LocalCluster) -> None:
    motions = [still("m", 10), still("n", 6)]
    run_motions(scene, tmp_path / "here", motions, SOLVER, 2, lambda *_: None)
    run_motions(scene, tmp_path / "there", motions, SOLVER, 2, lambda *_: None, cluster.scheduler_address)
    for name in ("m.frames", "n.frames"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()
    assert not (tmp_path / "there" / "lease").exists()


def test_a_worker_that_does_not_share_the_folder_is_told(scene: Path, tmp_path: Path, cluster: LocalCluster) -> None:
    elsewhere = Lease(tmp_path / "elsewhere", "token")
    with Client(cluster) as client, pytest.raises(SolverError, match=f"does not see {elsewhere.folder} as it is here"):
        client.submit(run_motion, scene, elsewhere, still("m", 5), SOLVER, file_hash(scene)).result()


def test_a_run_that_another_one_took_over_stops_after_its_frame(scene: Path, tmp_path: Path) -> None:
    lease = Lease.taken(tmp_path)
    endless = still("m", 1_000_000)
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(run_motion, scene, lease, endless, SOLVER, file_hash(scene))
        wait_until(lambda: (tmp_path / "m.checkpoint.h5").exists())
        assert Lease.taken(tmp_path).holds() and not lease.holds()
        with pytest.raises(SolverError, match="was taken over by another run"):
            future.result(WAIT)
    lease.given_back()
    assert (tmp_path / "lease").exists(), "whoever lost a lease cannot end the one of another"


@pytest.mark.parametrize(
    ("failure", "words"),
    [
        (BrokenProcessPool("died"), "worker processes died again and again on one motion (out of memory?)"),
        (KilledWorker("m", "worker", 3), "worker processes died again and again on one motion (out of memory?)"),
        (MemoryError("Unable to allocate 9 GiB"), "a worker ran out of memory (Unable to allocate 9 GiB)"),
    ],
    ids=["killed", "killed on a cluster", "told"],
)
def test_workers_without_memory_are_told_in_one_line(failure: Exception, words: str) -> None:
    future: Future[None] = Future()
    future.set_exception(failure)
    with pytest.raises(SolverError) as refusal:
        result(future, KilledWorker if isinstance(failure, KilledWorker) else BrokenProcessPool)
    message = str(refusal.value)
    assert message.startswith(words) and "finished frames are kept" in message and "\n" not in message
    assert ("__main__" in message) == ("died" in words), "a script without its guard ends its workers too"


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere://127.0.0.1:1", "127.0.0.1"])
def test_a_scheduler_that_cannot_be_reached_is_told_in_one_line(scene: Path, tmp_path: Path, address: str) -> None:
    with pytest.raises(SolverError, match="no Dask scheduler answers at") as refusal:
        run_motions(scene, tmp_path, [still("m", 3)], SOLVER, 1, lambda *_: None, address)
    assert "\n" not in str(refusal.value) and address in str(refusal.value)
    assert not list(tmp_path.iterdir())
