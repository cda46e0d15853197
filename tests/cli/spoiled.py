"""Ways in which the file of an artefact can be bad, with what is said of each."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from ldsim.artefacts.sealed_file import datasets
from tests.helpers import changed


def replace_kind(path: Path) -> None:
    with changed(path) as file:
        file.attrs["kind"] = "basis" if file.attrs["kind"] == "scene" else "scene"


def replace_experiment(path: Path) -> None:
    with changed(path) as file:
        file.attrs["experiment"] = "other"


def drop_dataset(path: Path) -> None:
    with changed(path) as file:
        # what fresh pulls came to may be left out
        del file[next(name for name in datasets(file) if not name.startswith("fresh/")).split("/")[0]]


ARTEFACTS: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "missing": (lambda path: path.unlink(), ("does not exist; run `ldsim ",)),
    "empty": (lambda path: path.write_bytes(b""), ("is not a readable HDF5 file",)),
    "truncated": (lambda path: os.truncate(path, path.stat().st_size // 2), ("is not a readable HDF5 file",)),
    "foreign": (lambda path: path.write_text("Vertices\n5\n"), ("is not a readable HDF5 file",)),
    "of another kind": (replace_kind, ("; expected '",)),
    "of another experiment": (replace_experiment, ("the experiment 'other'", "belongs to another experiment")),
    "without a group": (drop_dataset, ("lacks the dataset",)),
}
