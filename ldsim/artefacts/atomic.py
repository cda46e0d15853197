"""Writing a file or a folder whole: it takes its name when all of it is written, or what was there before stays."""

from __future__ import annotations

import contextlib
import errno
import glob
import io
import os
import platform
import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py

from ldsim.artefacts.sealed_file import BLOCK, seal
from ldsim.errors import ArtefactError

# Errors of a place that has no room left.
FULL = (errno.ENOSPC, errno.EDQUOT)
# Temporary names tell who writes: a disk may be shared by machines, and a process is known only on its own.
HOST = re.sub(r"\W", "_", platform.node())[:40]
# On Windows os.kill ends the process that it is to ask for.
KNOWS_PROCESSES = os.name == "posix"
# What a writer of which nothing is known has not touched for so long it has left, seconds.
FORGOTTEN = 24 * 3600.0


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the system's refusal to write into one line.

    Raises:
        ArtefactError: naming the path and the reason.
    """
    try:
        yield
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error).splitlines()[0]
        turn = "free some space" if error.errno in FULL else "write to a place that takes it"
        raise ArtefactError(f"cannot write {path}: {reason}; {turn} (finished artefacts are untouched)") from error


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside `path` that becomes `path` when the block ends well and is removed when it does not.

    Raises:
        ArtefactError: the folder cannot be written or the disk is full; what was there before is untouched.
    """
    temporary = temporary_name(path)
    try:
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            remove_leftovers(path)
            yield temporary
            os.replace(temporary, path)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def temporary_name(path: Path, kind: str = "partial") -> Path:
    """What this process calls an artefact that is not whole yet, or, with the kind "old", one that is replaced."""
    return path.with_name(f".{path.name}.{HOST}-{os.getpid()}.{kind}")


def remove_leftovers(path: Path) -> None:
    """Remove the temporary files and folders of processes that were killed while they wrote this artefact."""
    for leftover in path.parent.glob(f".{glob.escape(path.name)}.*"):
        *_, writer, kind = leftover.name.split(".")
        if kind in ("partial", "old") and _is_left(leftover, writer):
            if leftover.is_dir():
                shutil.rmtree(leftover, ignore_errors=True)
            else:
                leftover.unlink(missing_ok=True)


def _is_left(temporary: Path, writer: str) -> bool:
    """Whether nobody writes it any more: its process is gone or, where that is not known, it has long not changed."""
    host, _, process = writer.rpartition("-")
    if not process.isdecimal():
        return False
    if host == HOST and KNOWS_PROCESSES:
        return not _lives(int(process))
    try:
        return time.time() - temporary.stat().st_mtime > FORGOTTEN
    except OSError:  # it has just taken its name
        return False


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # somebody else's
        return True
    return True


class _Sink(io.RawIOBase):
    """The file below HDF5: seekable, and never failing, because HDF5 does not survive a failed write.

    On a full disk HDF5 prints traces and crashes when Python ends. Here the first error is kept for `check`, and what
    is written after it is lost; the file is then thrown away.
    """

    def __init__(self, stream: io.FileIO) -> None:
        self._stream = stream
        self._error: OSError | None = None

    def check(self) -> None:
        """Raise the first error of a write, if there was one."""
        if self._error is not None:
            raise self._error

    def write(self, data: memoryview) -> int:  # type: ignore[override]
        rest = memoryview(data).cast("B")
        size = len(rest)
        while len(rest) and self._error is None:
            try:
                rest = rest[self._stream.write(rest) or 0 :]
            except OSError as error:
                self._error = error
        return size

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        return self._stream.readinto(buffer) or 0

    def truncate(self, size: int | None = None) -> int:
        try:
            return self._stream.truncate(size)
        except OSError as error:
            self._error = self._error or error
            return size or 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._stream.seek(offset, whence)

    def tell(self) -> int:
        return self._stream.tell()

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True


@contextlib.contextmanager
def creating(path: Path, check: Callable[[h5py.File], None] | None = None) -> Iterator[h5py.File]:
    """A new HDF5 file that takes its name when whole, sealed with its checksum.

    Args:
        check: what is done with all of it before it takes its name. A file that is checked is an artefact, and whatever
            it was gathered from may be removed after it: it is on the disk by then, though the machine lose its power.

    Raises:
        ArtefactError: the folder cannot be written or the disk is full; what was there before is untouched.
    """
    with replacing(path) as temporary, open(temporary, "w+b", buffering=0) as stream:
        sink = _Sink(stream)
        with h5py.File(sink, "w", userblock_size=BLOCK) as file:
            yield file
            file.flush()
            sink.check()
            if check is not None:
                check(file)
        sink.check()
        seal(stream)
        if check is not None:
            os.fsync(stream.fileno())


@contextlib.contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """A temporary folder beside `path` that becomes `path` when the block ends well and is removed when it does not.

    POSIX cannot replace a folder that is not empty, so the old one is first renamed away; it comes back when the new
    one cannot take its place. A process killed between these two renames leaves no folder, never half of one.

    Raises:
        ArtefactError: the folder cannot be written or the disk is full; what was there before is untouched.
    """
    temporary, retired = temporary_name(path), temporary_name(path, "old")
    try:
        with writing(path):
            shutil.rmtree(temporary, ignore_errors=True)
            temporary.mkdir(parents=True)
            yield temporary
            _exchange(temporary, path, retired)
            remove_leftovers(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _exchange(temporary: Path, path: Path, retired: Path) -> None:
    """Put `temporary` in the place of `path`, whose old content is removed at the very end."""
    if path.exists():
        os.replace(path, retired)
    try:
        os.replace(temporary, path)
    except BaseException:
        if retired.exists():
            os.replace(retired, path)
        raise
    shutil.rmtree(retired, ignore_errors=True)
