"""Opening an HDF5 file of ours: nothing of it is believed before it is proved.

The first 512 bytes, HDF5's user block, hold the size and the SHA-256 of the rest. So a damaged file is refused before
the HDF5 library sees it, which may crash on one. A file that somebody made on purpose has the right sum; of it only
what we write ourselves is taken: groups and plain datasets, each with one name, that lie in the file itself.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import math
import os
from collections.abc import Iterator
from pathlib import Path

import h5py

from ldsim.errors import ArtefactError, LdsimError

BLOCK = 512
MAGIC = b"ldsim artefact, size and SHA-256 of what follows this block: "
MOST_OBJECTS = 100_000
# What h5py and numpy raise on content that is not what it should be.
FAULTS = (OSError, LookupError, ValueError, TypeError, ArithmeticError, RuntimeError, LdsimError)
# What the system says where a file may be whole, but is not to be had now.
REFUSALS = (
    *(errno.EACCES, errno.EPERM, errno.EIO, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ESTALE),
    *(errno.EAGAIN, errno.ENOLCK, errno.ENOTCONN, errno.ETIMEDOUT),
)


class UnreadableError(LdsimError):
    """A file that may be whole, but that the system does not let be read: who makes anew what is damaged lets it be."""


def seal(stream: io.FileIO) -> None:
    """Write the sum of a finished file, open to be read and written, into its user block."""
    block = _block(stream)
    stream.seek(0)
    stream.write(block)


def _block(stream: io.FileIO) -> bytes:
    """The user block that a file should have."""
    stream.seek(BLOCK)
    digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return MAGIC + f"{stream.seek(0, io.SEEK_END)} {digest}\n".encode().ljust(BLOCK - len(MAGIC), b"\0")


def check_seal(path: Path) -> None:
    """Compare a file with its user block.

    Raises:
        ArtefactError: it is no HDF5 file, was not written by ldsim, or was cut or changed since.
    """
    with path.open("rb", buffering=0) as stream:
        block, size = stream.read(BLOCK), stream.seek(0, io.SEEK_END)
        if not block.startswith(MAGIC) and h5py.is_hdf5(path):
            raise ArtefactError(
                f"{path} is not an ldsim artefact of this version, or not a readable HDF5 file: it lacks the checksum; "
                "delete it and run make"
            )
        if not block.startswith(MAGIC + f"{size} ".encode()):
            what = "delete it and run make" if path.suffix == ".h5" else "give a run, or one of its files ending in .h5"
            raise ArtefactError(f"{path} is not a readable HDF5 file (truncated or foreign); {what}")
        if block != _block(stream):
            raise ArtefactError(
                f"{path} is damaged, or another program has it open to write (its content does not fit its checksum); "
                "close that program, or delete the file and run make"
            )


@contextlib.contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """A file of ours, proved and open to be read; what fails in the block because of its content is told in one line.

    Raises:
        ArtefactError: naming the file, what was found, and what to do.
        UnreadableError: the system does not let it be read, whatever is in it.
    """
    try:
        check_seal(path)
        with _unlocked(path) as file:
            datasets(file)
            yield file
    except (BrokenPipeError, ArtefactError, UnreadableError):
        # a pipe breaks where whoever reads our output has left, which is not the file's fault
        raise
    except FAULTS as error:
        if isinstance(error, OSError) and error.errno in REFUSALS:
            raise UnreadableError(f"{path} cannot be read: {os.strerror(error.errno)}") from error
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise ArtefactError(f"{path} is damaged ({reason}); delete it and run make") from error


def _unlocked(path: Path) -> h5py.File:
    """Open it, without a lock where another program has that: the sum is proved, and who else reads it does no harm.

    With one at first, as h5py has it by default: within a process, HDF5 opens no file in both ways.
    """
    try:
        return h5py.File(path, "r")
    except OSError:
        return h5py.File(path, "r", locking=False)


def datasets(file: h5py.File) -> dict[str, h5py.Dataset]:
    """All datasets by path, sorted.

    Raises:
        ValueError: something that we never write: a link, a second name of one object, or data kept elsewhere.
    """
    found: dict[str, h5py.Dataset] = {}
    groups, seen = [""], {h5py.h5o.get_info(file["/"].id).addr}
    while groups:
        group = groups.pop()
        for name in file[f"/{group}"]:
            path = f"{group}/{name}".lstrip("/")
            if not isinstance(file.get(path, getlink=True), h5py.HardLink):
                raise ValueError(f"{path!r} is a link; an artefact holds its data itself")
            item = file[path]
            address = h5py.h5o.get_info(item.id).addr
            if address in seen or len(seen) > MOST_OBJECTS:
                raise ValueError(f"{path!r} is a second name of one object, or one of more than {MOST_OBJECTS}")
            seen.add(address)
            if isinstance(item, h5py.Group):
                groups.append(path)
            elif isinstance(item, h5py.Dataset):
                created = item.id.get_create_plist()
                if created.get_external_count() or created.get_nfilters() or created.get_layout() == h5py.h5d.VIRTUAL:
                    raise ValueError(f"dataset {path!r} is external, virtual or filtered; artefacts hold plain ones")
                found[path] = item
            else:
                raise ValueError(f"{path!r} is neither a group nor a dataset")
    return dict(sorted(found.items()))


def check_size(dataset: h5py.Dataset) -> None:
    """Refuse a dataset whose declared size is not there; it would be read as zeros, or not fit into memory.

    Raises:
        ValueError: see above.
    """
    declared = math.prod(dataset.shape) * dataset.dtype.itemsize
    if dataset.chunks is not None:
        counts = (math.ceil(size / chunk) for size, chunk in zip(dataset.shape, dataset.chunks, strict=True))
        declared = math.prod(counts) * math.prod(dataset.chunks) * dataset.dtype.itemsize
    stored = dataset.id.get_storage_size()
    if declared != stored or declared > dataset.file.id.get_filesize():
        raise ValueError(
            f"dataset {dataset.name!r} of shape {dataset.shape} needs {declared} bytes, there are {stored}"
        )
