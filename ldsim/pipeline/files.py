"""The files that options name, outside the run."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable
from pathlib import Path

from ldsim.errors import SettingsError
from ldsim.mesh.formats import companions

DATA_VARIABLE = "LDSIM_DATA"
VARIABLE = re.compile(rf"\$(?:{DATA_VARIABLE}\b|\{{{DATA_VARIABLE}\}})")
DATA_ORIGIN = "its authors publish it in the GitHub repository lawsonfulton/AutoDef"


def file_sums(names: Iterable[str], base: Path) -> str:
    """The files that options name, each with its SHA-256, as JSON: what an artefact says it was made from.

    Raises:
        SettingsError: one is not there.
    """
    paths = {name: resolve_path(name, base) for name in names}
    return json.dumps({name: content_hash(path) for name, path in paths.items()})


def content_hash(path: Path) -> str:
    """SHA-256 of a file, and of those that a mesh file is read with."""
    digest = hashlib.sha256()
    for each in (path, *companions(path)):
        digest.update(each.read_bytes())
    return digest.hexdigest()


def relative_path(path: Path, folder: Path) -> str:
    """A path as a configuration in some folder has it: relative, where there is a way, and alike on every system."""
    # through a link ".." leads elsewhere; of a file that is one, the name with its ending stays
    path, folder = path.parent.resolve() / path.name, folder.resolve()
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return path.as_posix()


def resolve_path(text: str, base: Path) -> Path:
    """A path of a configuration: $LDSIM_DATA expanded, relative to the folder `base`, that of the configuration.

    Raises:
        SettingsError: LDSIM_DATA is used but not set, or the file is not there or cannot be read.
    """
    from_data = VARIABLE.search(text) is not None
    if from_data:
        root = os.environ.get(DATA_VARIABLE, "")
        if not root:
            raise SettingsError(
                f"{text} needs the environment variable {DATA_VARIABLE}: the folder that holds the paper's meshes/ and "
                f"interactions/; {DATA_ORIGIN}"
            )
        root = str(Path(root).resolve())
        text = VARIABLE.sub(lambda _: root, text)
    try:
        path = base / Path(text).expanduser()
        there = path.exists()
    except RuntimeError as error:
        raise SettingsError(f"{text} begins with a name that has no home folder here; give the whole path") from error
    except OSError as error:  # a name that is too long, a folder that may not be searched
        raise SettingsError(f"{text} cannot be read: {error.strerror}; give a file that can be read") from error
    if not there:
        hint = f"; {DATA_VARIABLE} says where the paper's data lie, {DATA_ORIGIN}" if from_data else ""
        raise SettingsError(f"{path} does not exist{hint}")
    if not path.is_file():  # a folder, a device or a pipe, which might never end
        raise SettingsError(f"{path} is no file; give one that can be read to its end")
    if not os.access(path, os.R_OK):
        raise SettingsError(f"{path} may not be read by you; change its permissions or give another file")
    return path
