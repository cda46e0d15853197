"""Writing and reading artefacts: HDF5 with a header, checked against the schema of its kind."""

from __future__ import annotations

import contextlib
import fnmatch
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.atomic import creating
from ldsim.artefacts.schema import SCHEMA_VERSION, SCHEMAS, Dataset
from ldsim.errors import ArtefactError

STAGE_OF = {
    "scene": "mesh",
    "snapshots": "snapshot",
    "basis": "pca",
    "model": "train",
    "cubature": "cubature",
    "simulation": "simulate",
}
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


def write(path: Path, header: Header, datasets: Mapping[str, NDArray[np.generic] | float | int]) -> None:
    """Write an artefact whole.

    Raises:
        ArtefactError: the datasets do not fit the schema, or the file cannot be written.
    """
    with creating(path) as file:
        write_header(file, header)
        for name, values in datasets.items():
            file.create_dataset(name, data=values)
        check_datasets(file, header.kind, path)


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
def reading(path: Path, kind: str | None = None) -> Iterator[h5py.File]:
    """An artefact, open and checked against its schema.

    Raises:
        ArtefactError: the file is missing, truncated or not an artefact, or of another kind or schema version.
    """
    if not path.is_file():
        hint = f"; run `ldsim {STAGE_OF[kind]}` first" if kind else ""
        raise ArtefactError(f"{path} does not exist{hint}")
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise ArtefactError(
            f"{path} is not a readable HDF5 file (truncated or foreign); delete it and run make"
        ) from error
    with file:
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
        check_datasets(file, found, path)
        try:
            yield file
        except BrokenPipeError:  # whoever reads our output left: not the file's fault
            raise
        except (OSError, KeyError) as error:
            raise ArtefactError(f"{path} is damaged ({str(error).splitlines()[0]}); delete it and run make") from error


def read_header(file: h5py.File) -> Header:
    """The header of an open artefact."""
    attributes = dict(file.attrs)
    notes = {name: _plain(value) for name, value in attributes.items() if name not in HEADER}
    return Header(
        kind=str(attributes["kind"]),
        settings=str(attributes["settings"]),
        inputs=json.loads(str(attributes["inputs"])),
        seed=int(attributes["seed"]),
        notes=notes,
        ldsim_version=str(attributes["ldsim_version"]),
        created=str(attributes["created"]),
    )


def _plain(value: object) -> str | float | int:
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, np.floating):
        return float(value)
    return str(value)


def check_inputs(path: Path, header: Header, given: Mapping[str, Path]) -> None:
    """Refuse an artefact that was made from other files than the given ones.

    Raises:
        ArtefactError: naming the artefact, the input whose hash differs, and what to do; or an input cannot be read.
    """
    for name, source in given.items():
        recorded = header.inputs.get(name)
        with reading(source, name):
            pass
        if recorded is not None and recorded != file_hash(source):
            raise ArtefactError(
                f"{path} was made from another {name} than {source} (SHA-256 {recorded[:12]}… recorded); "
                "it belongs to another experiment or is stale: run make"
            )


def dataset_names(file: h5py.File) -> list[str]:
    """Paths of all datasets, sorted."""
    names: list[str] = []
    file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    return sorted(names)


def check_datasets(file: h5py.File, kind: str, path: Path) -> None:
    """Compare every dataset with the schema of its kind.

    Raises:
        ArtefactError: naming file, dataset, what was found and what was expected.
    """
    if kind not in SCHEMAS:
        raise ArtefactError(f"{path} holds the unknown kind {kind!r}; known are {', '.join(SCHEMAS)}")
    names = dataset_names(file)
    unknown = [name for name in names if not any(_matches(name, entry.path) for entry in SCHEMAS[kind])]
    if unknown:
        raise ArtefactError(f"{path} holds the dataset {unknown[0]!r}, which a {kind} artefact does not have")
    symbols: dict[tuple[str, str], int] = {}
    for entry in SCHEMAS[kind]:
        matches = [name for name in names if _matches(name, entry.path)]
        lacking = [] if entry.optional else _lacking(entry, matches, names)
        if lacking:
            raise ArtefactError(f"{path} lacks the dataset {lacking[0]!r}; it is damaged, delete it and run make")
        for name in matches:
            _check_dataset(file[name], entry, name, path, symbols)


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
    group = name.rsplit("/", 1)[0] if "*" in entry.path else ""
    if "*" in entry.path.rsplit("/", 1)[-1]:
        group = name
    for size, symbol in zip(dataset.shape, entry.shape, strict=True):
        known = symbol if isinstance(symbol, int) else symbols.setdefault((group, symbol), size)
        if size != known:
            raise ArtefactError(
                f"{path}, dataset {name!r}: found shape {dataset.shape}, expected ({wanted}) with {symbol} = {known}"
            )
