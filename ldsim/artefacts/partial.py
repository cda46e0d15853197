"""Runs that are not finished: frames and a checkpoint for each motion, gathered into snapshots.h5 at the end."""

from __future__ import annotations

import contextlib
import os
import secrets
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.artefacts.atomic import creating, replacing, writing
from ldsim.artefacts.sealed_file import opened
from ldsim.artefacts.snapshots import CHUNK_BYTES, STATISTICS, Snapshots, motion_arrays
from ldsim.artefacts.store import Header, check_datasets, write_header
from ldsim.errors import ArtefactError
from ldsim.mechanics.motion import Motion

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl


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
    state: Mapping[str, Any]
    held: Mapping[int, Indices]
    statistics: Mapping[str, Indices]
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

    @property
    def taken_over(self) -> bool:
        """Whether another run has the folder now."""
        return self._path.is_file() and not self.holds()

    def given_back(self) -> None:
        """End the right, and with it the workers that still write."""
        if self.holds():
            with contextlib.suppress(OSError):
                self._path.unlink()


def _own(file: int) -> None:
    """Wait until no other process has the lock of a file; it is given up where that is closed."""
    if sys.platform == "win32":
        while True:
            with contextlib.suppress(OSError):
                msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
                return
            time.sleep(0.1)
    else:
        fcntl.flock(file, fcntl.LOCK_EX)


class MotionStore:
    """The files of one motion's run: frames appended one by one, and a checkpoint replaced now and then."""

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
            _own(lock.fileno())
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
        """The checkpoint of this very run, or None; frames written after it are cut off.

        Raises:
            UnreadableError: there may be one, but the system does not let it be read.
        """
        try:
            with opened(self._checkpoint_path) as file:
                if file.attrs["identity"] != identity:
                    return None
                state = {name: data[()] for name, data in file["state"].items()}
                held = {int(drag): data[:] for drag, data in file["held"].items()} if "held" in file else {}
                statistics = {name: data[:] for name, data in file["statistics"].items()}
                checkpoint = Checkpoint(identity, state, held, statistics, file["seconds"][:])
        except (OSError, ArtefactError):
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
        with opened(self._checkpoint_path) as file:
            held = {int(drag): data[:] for drag, data in file["held"].items()} if "held" in file else {}
            for name in STATISTICS:
                group[name] = file[f"statistics/{name}"][:]
            group["seconds"] = file["seconds"][:]
            group.attrs["identity"] = file.attrs["identity"]
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


class Stored(Protocol):
    """A finished run of a motion, wherever it lies."""

    def copy_into(self, group: h5py.Group, n_vertices: int) -> None:
        """Put its datasets into a group of another file."""

    def remove(self) -> None:
        """Forget what was only there until it was put there."""


@dataclass(frozen=True)
class StoredBefore:
    """A motion of an artefact that lies there already."""

    snapshots: Snapshots
    name: str

    def copy_into(self, group: h5py.Group, n_vertices: int) -> None:
        self.snapshots.copy_into(self.name, group)

    def remove(self) -> None:
        """Nothing: the artefact is replaced as a whole."""


def write_snapshots(path: Path, header: Header, stores: Sequence[tuple[Stored, Motion, str]], n_vertices: int) -> None:
    """Gather finished runs into snapshots.h5 or tests.h5 and remove their partial files."""
    with creating(path, lambda file: check_datasets(file, header.kind, path)) as file:
        write_header(file, header)
        for order, (store, motion, role) in enumerate(stores):
            group = file.create_group(f"motions/{motion.name}")
            group.attrs["role"], group.attrs["order"], group.attrs["frames"] = role, order, motion.frames
            store.copy_into(group, n_vertices)
    for store, _, _ in stores:
        store.remove()
