"""snapshots.h5: the full-space run of every motion, streamed; and the checkpoints of runs that are not finished."""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.store import (
    Header,
    check_datasets,
    creating,
    read_header,
    reading,
    replacing,
    write_header,
    writing,
)
from ldsim.mechanics.motion import Drag, Motion, Support

Array = NDArray[np.float64]

CHUNK_BYTES = 128 << 20
STATISTICS = ("iterations", "evaluations", "reason")


@dataclass(frozen=True, eq=False)
class Recorded:
    """A motion as it ran in the full space.

    Attributes:
        motion: what pulled.
        role: "train" or "heldout".
        held: held vertices of each drag.
        iterations, evaluations, reason, seconds: of each frame, (N,).
    """

    motion: Motion
    role: str
    held: Mapping[int, NDArray[np.int64]]
    iterations: NDArray[np.int64]
    evaluations: NDArray[np.int64]
    reason: NDArray[np.int64]
    seconds: Array


def motion_arrays(motion: Motion, held: Mapping[int, NDArray[np.int64]]) -> dict[str, NDArray[np.generic]]:
    """A motion and its held vertices as arrays."""
    drags, supports = motion.drags, motion.supports
    vertices = [held.get(i, np.empty(0, dtype=np.int64)) for i in range(len(drags))]
    optional: dict[str, NDArray[np.generic]] = {} if motion.gravity is None else {"gravity": motion.gravity}
    if supports:
        optional["support_maps"] = np.stack([support.maps for support in supports])
        optional["support_vertices"] = np.concatenate([support.vertices for support in supports])
        optional["support_count"] = np.array([len(support.vertices) for support in supports], dtype=np.int64)
    return {
        "drag_start": np.array([drag.start for drag in drags], dtype=np.int64),
        "drag_frames": np.array([len(drag.targets) for drag in drags], dtype=np.int64),
        "drag_point": np.array([drag.point for drag in drags], dtype=np.float64).reshape(-1, 3),
        "drag_radius": np.array([drag.radius for drag in drags], dtype=np.float64),
        "drag_stiffness": np.array([drag.stiffness for drag in drags], dtype=np.float64),
        "drag_at_rest": np.array([drag.at_rest for drag in drags], dtype=bool),
        "targets": np.concatenate([np.empty((0, 3)), *(drag.targets for drag in drags)]),
        "held": np.concatenate([np.empty(0, dtype=np.int64), *vertices]),
        "held_count": np.array([len(v) for v in vertices], dtype=np.int64),
        **optional,
    }


def read_motion(group: h5py.Group, name: str) -> tuple[Motion, dict[int, NDArray[np.int64]]]:
    """A motion and its held vertices from the group that holds its arrays."""
    frames = group["drag_frames"][:]
    targets = np.split(group["targets"][:], np.cumsum(frames)[:-1]) if len(frames) else []
    held = np.split(group["held"][:], np.cumsum(group["held_count"][:])[:-1]) if len(frames) else []
    columns = [group[key][:] for key in ("drag_start", "drag_point", "drag_radius", "drag_stiffness", "drag_at_rest")]
    drags = tuple(
        Drag(int(start), point, target, float(radius), float(stiffness), bool(at_rest))
        for start, point, radius, stiffness, at_rest, target in zip(*columns, targets, strict=True)
    )
    settled = {i: vertices for i, vertices in enumerate(held) if len(vertices)}
    gravity = group["gravity"][:] if "gravity" in group else None
    return Motion(name, int(group.attrs["frames"]), drags, gravity, _supports(group)), settled


def _supports(group: h5py.Group) -> tuple[Support, ...]:
    if "support_maps" not in group:
        return ()
    vertices = np.split(group["support_vertices"][:], np.cumsum(group["support_count"][:])[:-1])
    return tuple(Support(*pair) for pair in zip(vertices, group["support_maps"][:], strict=True))


class Snapshots:
    """snapshots.h5, open for reading; displacements are read in chunks of bounded size.

    Use as a context manager.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> Snapshots:
        self._context = reading(self._path, "snapshots")
        self._file = self._context.__enter__()
        self.header: Header = read_header(self._file)
        return self

    def __exit__(self, *error: object) -> None:
        self._context.__exit__(None, None, None)

    @property
    def names(self) -> list[str]:
        """Motions in the order of the configuration."""
        groups = self._file["motions"]
        return sorted(groups, key=lambda name: int(groups[name].attrs["order"]))

    def with_role(self, role: str) -> list[str]:
        return [name for name in self.names if self._file["motions"][name].attrs["role"] == role]

    def recorded(self, name: str) -> Recorded:
        """A motion with its statistics, without the displacements."""
        group = self._file["motions"][name]
        motion, held = read_motion(group, name)
        statistics = (group[key][:] for key in (*STATISTICS, "seconds"))
        return Recorded(motion, str(group.attrs["role"]), held, *statistics)

    def frames(self, name: str) -> int:
        return int(self._file["motions"][name].attrs["frames"])

    def reader(self, name: str) -> Callable[[int, int], NDArray[np.float32]]:
        """The function (start, stop) → frames start … stop − 1 of a motion, (frames, n, 3) float32, metres."""
        data = self._file["motions"][name]["displacements"]
        return lambda start, stop: data[start:stop]

    def frame_reader(self, names: list[str]) -> Callable[[int], NDArray[np.float32]]:
        """The function t → frame t of the given motions one after the other, (n, 3) float32, metres."""
        ends = np.cumsum([self.frames(name) for name in names])
        readers = [self.reader(name) for name in names]

        def frame(t: int) -> NDArray[np.float32]:
            i = int(np.searchsorted(ends, t, side="right"))
            local = t - (int(ends[i - 1]) if i else 0)
            found: NDArray[np.float32] = readers[i](local, local + 1)[0]
            return found

        return frame

    def chunks(self, names: list[str]) -> Iterator[NDArray[np.float32]]:
        """Rows of displacements (b, 3n) float32 of the given motions, in bounded pieces."""
        for name in names:
            data = self._file["motions"][name]["displacements"]
            rows = max(CHUNK_BYTES // (data.shape[1] * 12), 1)
            for start in range(0, len(data), rows):
                part = data[start : start + rows]
                yield part.reshape(len(part), -1)


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """Where an unfinished run of a motion stands; all arrays it needs to go on as if undisturbed.

    Attributes:
        identity: hash of the scene, the motion and the solver's settings; another identity is another run.
        state: the stepper's state by name.
        held: held vertices of the drags so far.
        statistics: (frames so far,) each.
    """

    identity: str
    state: Mapping[str, Array | int]
    held: Mapping[int, NDArray[np.int64]]
    statistics: Mapping[str, NDArray[np.int64]]
    seconds: Array

    @property
    def frames(self) -> int:
        return len(self.seconds)


@dataclass(frozen=True)
class Lease:
    """The right to append frames to a folder: a file that holds the token of the run that was started last.

    A worker on another machine sees by it whether it shares the folder, and when it is to stop.
    """

    folder: Path
    token: str

    @classmethod
    def taken(cls, folder: Path) -> Lease:
        """Take the folder over from whoever had it."""
        lease = cls(folder, secrets.token_hex(16))
        with replacing(lease._path) as temporary:
            temporary.write_text(lease.token, encoding="utf-8")
        return lease

    @property
    def _path(self) -> Path:
        return self.folder / "lease"

    def holds(self) -> bool:
        """Whether this run may still write."""
        try:
            return self._path.read_text(encoding="utf-8") == self.token
        except OSError:
            return False

    def given_back(self) -> None:
        """End the right, and with it the workers that still write."""
        if self.holds():
            with contextlib.suppress(OSError):
                self._path.unlink()


class MotionStore:
    """The files of one motion's run: frames appended one by one, and a checkpoint replaced after each."""

    def __init__(self, folder: Path, motion: Motion) -> None:
        self._folder = folder
        self._motion = motion
        self._frames_path = folder / f"{motion.name}.frames"
        self._checkpoint_path = folder / f"{motion.name}.checkpoint.h5"
        self._lock_path = folder / f"{motion.name}.lock"

    @contextlib.contextmanager
    def owned(self) -> Iterator[None]:
        """Wait until no other process runs this motion, and keep others from it for the block."""
        with writing(self._lock_path):
            self._folder.mkdir(parents=True, exist_ok=True)
            lock = self._lock_path.open("w")
        with lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def write_checkpoint(self, checkpoint: Checkpoint) -> None:
        """Replace the checkpoint."""
        with creating(self._checkpoint_path) as file:
            file.attrs["identity"] = checkpoint.identity
            for name, values in checkpoint.state.items():
                file[f"state/{name}"] = values
            for name, counts in checkpoint.statistics.items():
                file[f"statistics/{name}"] = counts
            file["seconds"] = checkpoint.seconds
            for drag, vertices in checkpoint.held.items():
                file[f"held/{drag}"] = vertices

    def read_checkpoint(self, identity: str, frame_bytes: int) -> Checkpoint | None:
        """The checkpoint of this very run, or None; frames written after it are cut off."""
        try:
            with h5py.File(self._checkpoint_path, "r") as file:
                if file.attrs["identity"] != identity:
                    return None
                state = {name: data[()] for name, data in file["state"].items()}
                held = {int(drag): data[:] for drag, data in file["held"].items()} if "held" in file else {}
                statistics = {name: data[:] for name, data in file["statistics"].items()}
                checkpoint = Checkpoint(identity, state, held, statistics, file["seconds"][:])
        except (OSError, KeyError):
            return None
        expected = checkpoint.frames * frame_bytes
        if not self._frames_path.is_file() or self._frames_path.stat().st_size < expected:
            return None
        os.truncate(self._frames_path, expected)
        return checkpoint

    def start(self) -> None:
        """Forget whatever an earlier run left."""
        with writing(self._frames_path):
            self._folder.mkdir(parents=True, exist_ok=True)
            self._frames_path.write_bytes(b"")
            self._checkpoint_path.unlink(missing_ok=True)

    def append(self, u: Array) -> None:
        """Append one frame, (n, 3) metres, as float32."""
        with writing(self._frames_path), self._frames_path.open("ab") as stream:
            stream.write(np.ascontiguousarray(u, dtype=np.float32).tobytes())

    def frames_written(self, frame_bytes: int) -> int:
        """Frames in the file so far; 0 when there is none."""
        try:
            return self._frames_path.stat().st_size // frame_bytes
        except OSError:
            return 0

    def copy_into(self, group: h5py.Group, n_vertices: int) -> None:
        """Move the finished run into its group of snapshots.h5, in bounded pieces."""
        frames = self._motion.frames
        with h5py.File(self._checkpoint_path, "r") as file:
            held = {int(drag): data[:] for drag, data in file["held"].items()} if "held" in file else {}
            for name in STATISTICS:
                group[name] = file[f"statistics/{name}"][:]
            group["seconds"] = file["seconds"][:]
        for name, values in motion_arrays(self._motion, held).items():
            group[name] = values
        data = group.create_dataset("displacements", (frames, n_vertices, 3), "f4", chunks=(1, n_vertices, 3))
        rows = max(CHUNK_BYTES // (n_vertices * 12), 1)
        with self._frames_path.open("rb") as stream:
            for start in range(0, frames, rows):
                count = min(rows, frames - start)
                part = np.fromfile(stream, dtype=np.float32, count=count * n_vertices * 3)
                data[start : start + count] = part.reshape(count, n_vertices, 3)

    def remove(self) -> None:
        for path in (self._frames_path, self._checkpoint_path, self._lock_path):
            path.unlink(missing_ok=True)


def write_snapshots(
    path: Path, header: Header, stores: Sequence[tuple[MotionStore, Motion, str]], n_vertices: int
) -> None:
    """Gather finished runs into snapshots.h5 and remove their partial files."""
    with creating(path) as file:
        write_header(file, header)
        for order, (store, motion, role) in enumerate(stores):
            group = file.create_group(f"motions/{motion.name}")
            group.attrs["role"], group.attrs["order"], group.attrs["frames"] = role, order, motion.frames
            store.copy_into(group, n_vertices)
        check_datasets(file, header.kind, path)
    for store, _, _ in stores:
        store.remove()
