"""Writing and reading artefacts: HDF5 with a header, checked against the schema of its kind."""

from __future__ import annotations

import contextlib
import fnmatch
import hashlib
import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Indices
from ldsim.artefacts.atomic import creating
from ldsim.artefacts.schema import ANY, SCHEMA_VERSION, SCHEMAS, SHARED, Dataset, index
from ldsim.artefacts.sealed_file import check_size, datasets, opened
from ldsim.errors import ArtefactError

STAGE_OF = {
    "scene": "mesh",
    "snapshots": "snapshot",
    "basis": "pca",
    "model": "train",
    "cubature": "cubature",
    "simulation": "simulate",
}
# Motions of the role test lie in a file of their own, which nothing but simulate and what follows reads.
WRITTEN_BY = STAGE_OF | {"tests": "snapshot"}
CHUNK_BYTES = 64 << 20
# Attributes that are numbers in every header that has them.
NUMBERS = re.compile(r"(\w+_)?(seconds|points|memory_mb)|met|quasistatic|material_changed")
HEADER = ("kind", "schema_version", "ldsim_version", "created", "settings", "inputs", "seed")


@dataclass(frozen=True)
class Header:
    """The attributes on `/` of every artefact.

    Attributes:
        kind: a key of `schema.SCHEMAS`.
        settings: YAML of the stage that wrote it.
        inputs: name of each artefact read → SHA-256 of its file.
        seed: of everything random in the stage, −1 where nothing is.
        notes: further attributes such as the experiment, seconds and peak memory.
    """

    kind: str
    settings: str
    inputs: Mapping[str, str] = field(default_factory=dict)
    seed: int = -1
    notes: Mapping[str, str | float | int] = field(default_factory=dict)
    ldsim_version: str = ""
    created: str = ""


def file_hash(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


# By path; where there is nothing to say, None stands for a dataset that is left out.
Given = Mapping[str, NDArray[np.generic] | float | int | None]


def write(path: Path, header: Header, given: Given) -> None:
    """Write an artefact whole.

    Raises:
        ArtefactError: the datasets do not fit the schema, or the file cannot be written.
    """
    with creating(path, lambda file: check_datasets(file, header.kind, path)) as file:
        write_header(file, header)
        for name, values in given.items():
            if values is not None:
                file.create_dataset(name, data=values)


def write_header(file: h5py.File, header: Header) -> None:
    """The attributes on `/`."""
    from ldsim import __version__

    file.attrs["kind"] = header.kind
    file.attrs["schema_version"] = SCHEMA_VERSION
    file.attrs["ldsim_version"] = __version__
    file.attrs["created"] = datetime.now(UTC).isoformat(timespec="seconds")
    file.attrs["settings"] = header.settings
    file.attrs["inputs"] = json.dumps(dict(header.inputs))
    file.attrs["seed"] = header.seed
    for name, value in header.notes.items():
        file.attrs[name] = value


@contextlib.contextmanager
def reading(path: Path, kind: str | None = None, sizes: Mapping[str, int] | None = None) -> Iterator[h5py.File]:
    """An artefact, open and proved: its checksum, its layout, its header, and every dataset against its schema.

    Args:
        sizes: of symbols of the schema that are known from other artefacts (`check_datasets`).

    Raises:
        ArtefactError: the file is missing, damaged or not an artefact, of another kind or schema version, or something
            in it is not what it should be; also what is read of it in the block.
    """
    if not path.is_file():
        stage = WRITTEN_BY.get(kind or "")
        hint = f"run `ldsim {stage}` first" if stage else "`ldsim list` names the runs that there are"
        raise ArtefactError(f"{path} does not exist; {hint}")
    with opened(path) as file:
        missing = [name for name in HEADER if name not in file.attrs]
        if missing:
            raise ArtefactError(f"{path} is not an ldsim artefact: it lacks the attribute {missing[0]!r}")
        found, version = str(file.attrs["kind"]), str(file.attrs["schema_version"])
        if kind is not None and found != kind:
            raise ArtefactError(f"{path} holds {found!r}; expected {kind!r}")
        if version != str(SCHEMA_VERSION):
            raise ArtefactError(
                f"{path} has schema version {version}; this ldsim reads {SCHEMA_VERSION}; delete it and run make"
            )
        read_header(file)
        check_datasets(file, found, path, sizes)
        yield file


def read_header(file: h5py.File) -> Header:
    """The header of an open artefact.

    Raises:
        ValueError: an attribute is not what it should be.
    """
    attributes = {name: _plain(name, value) for name, value in file.attrs.items()}
    texts = {name: attributes[name] for name in HEADER if name not in ("schema_version", "seed")}
    inputs = json.loads(str(attributes["inputs"]))
    sums = inputs.values() if isinstance(inputs, dict) else [None]
    if not all(isinstance(text, str) for text in (*texts.values(), *sums)) or not isinstance(attributes["seed"], int):
        raise ValueError("an attribute of its header has another type than it should have")
    return Header(
        kind=str(attributes["kind"]),
        settings=str(attributes["settings"]),
        inputs=inputs,
        seed=attributes["seed"],
        notes={name: value for name, value in attributes.items() if name not in HEADER},
        ldsim_version=str(attributes["ldsim_version"]),
        created=str(attributes["created"]),
    )


def optional(group: h5py.Group, name: str) -> NDArray[Any] | None:
    """A dataset that need not be there."""
    return group[name][:] if name in group else None


def _plain(name: str, value: object) -> str | float | int:
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, np.floating) and np.isfinite(value):
        return float(value)
    if isinstance(value, str) and value.isprintable() | (name == "settings") and not NUMBERS.fullmatch(name):
        return value
    raise ValueError(f"attribute {name!r} is not the text or the finite number that it should be")


def pieces(values: NDArray[Any], counts: Indices) -> list[NDArray[Any]]:
    """An array that holds several one after another, taken apart.

    Raises:
        ValueError: the counts do not add up to it.
    """
    if counts.sum() != len(values) or (counts < 0).any():
        raise ValueError(f"{len(values)} values are there, their counts add up to {counts.sum()}")
    return np.split(values, np.cumsum(counts)[:-1]) if len(counts) else []


def check_datasets(file: h5py.File, kind: str, path: Path, sizes: Mapping[str, int] | None = None) -> None:
    """Compare every dataset with the schema of its kind.

    Args:
        sizes: of symbols that are known from other artefacts, n, or latent/k for those of one group.

    Raises:
        ArtefactError: naming file, dataset, what was found and what was expected.
    """
    if kind not in SCHEMAS:
        raise ArtefactError(f"{path} holds the unknown kind {kind!r}; known are {', '.join(SCHEMAS)}")
    found = datasets(file)
    names = list(found)
    if kind == "tests" and not names:  # no motion has the role test
        return
    unknown = [name for name in names if not any(_matches(name, entry.path) for entry in SCHEMAS[kind])]
    if unknown:
        raise ArtefactError(f"{path} holds the dataset {unknown[0]!r}, which a {kind} artefact does not have")
    symbols = {(name.rpartition("/")[0], name.rpartition("/")[2]): size for name, size in (sizes or {}).items()}
    matches = {entry: [name for name in names if _matches(name, entry.path)] for entry in SCHEMAS[kind]}
    for entry, its in matches.items():
        lacking = [] if entry.optional else _lacking(entry, its, names)
        if lacking:
            raise ArtefactError(f"{path} lacks the dataset {lacking[0]!r}; it is damaged, delete it and run make")
        for name in its:
            _check_dataset(found[name], entry, name, path, symbols)
    for entry, its in matches.items():
        for name in its:
            _check_values(found[name], entry, name, path, symbols)


def _lacking(entry: Dataset, matches: list[str], names: list[str]) -> list[str]:
    """What is missing of a dataset that must be there: at least one, and one in every group of its kind."""
    pattern, _, last = entry.path.rpartition("/")
    groups = {name.rpartition("/")[0] for name in names}
    homes = sorted(group for group in groups if _matches(group, pattern)) or [pattern]
    return [f"{home}/{last}".lstrip("/") for home in homes if not any(m.rpartition("/")[0] == home for m in matches)]


def _matches(name: str, pattern: str) -> bool:
    parts, wanted = name.split("/"), pattern.split("/")
    return len(parts) == len(wanted) and all(fnmatch.fnmatchcase(a, b) for a, b in zip(parts, wanted, strict=True))


def _check_dataset(
    dataset: h5py.Dataset, entry: Dataset, name: str, path: Path, symbols: dict[tuple[str, str], int]
) -> None:
    expected = np.dtype(entry.dtype)
    if dataset.dtype != expected:
        raise ArtefactError(f"{path}, dataset {name!r}: found type {dataset.dtype}, expected {expected}")
    wanted = ", ".join(str(size) for size in entry.shape)
    if len(dataset.shape) != len(entry.shape):
        raise ArtefactError(f"{path}, dataset {name!r}: found shape {dataset.shape}, expected ({wanted})")
    for size, symbol in zip(dataset.shape, entry.shape, strict=True):
        known = symbol if isinstance(symbol, int) else symbols.setdefault(_key(entry, name, symbol), size)
        if size != known:
            raise ArtefactError(
                f"{path}, dataset {name!r}: found shape {dataset.shape}, expected ({wanted}) with {symbol} = {known}"
            )

    check_size(dataset)


def _key(entry: Dataset, name: str, symbol: str) -> tuple[str, str]:
    """Where a symbol is at home: in the file, or in the group, or the one dataset, that `*` stands for."""
    parent, _, last = entry.path.rpartition("/")
    if symbol in SHARED or "*" not in entry.path:
        return "", symbol
    return (name if "*" in last else name.rpartition("/")[0]), symbol


def _check_values(
    dataset: h5py.Dataset, entry: Dataset, name: str, path: Path, symbols: Mapping[tuple[str, str], int]
) -> None:
    allowed = index(2) if dataset.dtype.kind == "b" else entry.allowed
    if allowed is ANY or dataset.size == 0:
        return
    below = allowed.below
    if isinstance(below, str):
        below = symbols.get(_key(entry, name, below), symbols.get(("", below), math.inf))
    rows = max(CHUNK_BYTES * max(len(dataset), 1) // dataset.nbytes, 1) if dataset.shape else 1
    for start in range(0, len(dataset) if dataset.shape else 1, rows):
        values = np.atleast_1d(dataset[start : start + rows] if dataset.shape else dataset[()])
        values = values.view(np.uint8) if values.dtype == bool else values
        wrong = (values < allowed.least) | (values >= below) & np.isfinite(values)
        if allowed.finite:
            wrong |= ~np.isfinite(values)
        if wrong.any():
            what = allowed.words if below == math.inf else f"0 … {below - 1}"
            raise ArtefactError(
                f"{path}, dataset {name!r}: found {values[wrong][0]:g}, expected {what}; delete it and run make"
            )
