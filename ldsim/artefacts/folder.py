"""Writing a folder whole: the report's files belong together, so they come into being together."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from ldsim.artefacts.atomic import remove_leftovers, writing


@contextlib.contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """A temporary folder beside `path` that becomes `path` when the block ends well and is removed when it does not.

    POSIX cannot replace a folder that is not empty, so the old one is first renamed away; it comes back when the new
    one cannot take its place. A process killed between these two renames leaves no folder, never half of one.

    Raises:
        ArtefactError: the folder cannot be written or the disk is full; what was there before is untouched.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.partial")
    retired = path.with_name(f".{path.name}.{os.getpid()}.old")
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
