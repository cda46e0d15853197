"""Ways to spoil what is read: bytes, datasets and attributes of artefacts, lines of texts. All drawn from one seed."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from ldsim.artefacts.sealed_file import BLOCK, datasets, seal

Rng = np.random.Generator
NASTY = ("", *"-1 0 1e308 -1e308 nan .inf 99999999999999999999 null [] {} .. /dev/zero true".split())
NUMBERS = (np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300, 2.0**31, 2.0**62)


def bytes_flipped(path: Path, rng: Rng, first: int = 0) -> None:
    """A few bits, in the whole file or behind the block of the checksum."""
    content = bytearray(path.read_bytes())
    for place in rng.integers(8 * first, 8 * len(content), int(rng.integers(1, 9))):
        content[place // 8] ^= 1 << int(place % 8)
    path.write_bytes(content)


def cut(path: Path, rng: Rng) -> None:
    """A piece from the end, or from the middle."""
    content = path.read_bytes()
    a, b = sorted(rng.integers(0, len(content), 2))
    path.write_bytes(content[:a] + (content[b:] if rng.random() < 0.5 else b""))


def sealed(path: Path) -> None:
    """The checksum of a file that was changed on purpose."""
    with path.open("r+b", buffering=0) as stream:
        seal(stream)


def metadata_flipped(path: Path, rng: Rng) -> None:
    """Bits of the structure, with a checksum that fits: what HDF5's own library is up to."""
    bytes_flipped(path, rng, first=BLOCK)
    sealed(path)


def dataset_spoilt(path: Path, rng: Rng) -> None:
    """A dataset gone, cut, grown, of another type, linked, or with a number that it must not have."""
    with h5py.File(path, "r+") as file:
        name = str(rng.choice(list(datasets(file))))
        values = file[name][()]
        array, what = np.asarray(values), int(rng.integers(7))
        if what == 0 and array.dtype.kind == "f" and array.size:
            array = array.copy()
            array.flat[int(rng.integers(array.size))] = rng.choice(NUMBERS)
        elif what <= 1 and array.dtype.kind == "i" and array.size:
            array = array.copy()
            array.flat[int(rng.integers(array.size))] = rng.choice([-1, -(2**40), 10**6, 2**40]).astype(array.dtype)
        del file[name]
        if what <= 1:
            file[name] = array
        elif what == 2 and array.ndim:
            file[name] = (
                np.delete(array, 0, axis=int(rng.integers(array.ndim))) if 0 not in array.shape else array[..., None]
            )
        elif what == 3:
            file[name] = np.concatenate([array, array]) if array.ndim else array[None]
        elif what == 4:
            file[name] = array.astype("f4" if array.dtype != np.float32 else "f8")
        elif what == 5:
            file[name] = h5py.SoftLink("/nowhere")
    sealed(path)


def attribute_spoilt(path: Path, rng: Rng) -> None:
    """An attribute gone or of another type."""
    with h5py.File(path, "r+") as file:
        holders = [file, *(file[name].parent for name in datasets(file))]
        attributes = next(h.attrs for h in (holders[i] for i in rng.permutation(len(holders))) if len(h.attrs))
        name = str(rng.choice(list(attributes)))
        del attributes[name]
        changes = ("text", -1, np.nan, np.arange(3), np.void(b"\xff"), "\x1b[2J", None)
        value = changes[int(rng.integers(len(changes)))]
        if value is not None:
            attributes[name] = value
    sealed(path)


# Layouts that we never write, of one dataset; the checksum is made to fit afterwards.


def external(file: h5py.File, name: str) -> None:
    data = file[name]
    shape, dtype = data.shape, data.dtype
    del file[name]
    file.create_dataset(name, shape, dtype, external=[("/etc/hostname", 0, h5py.h5f.UNLIMITED)])


def virtual(file: h5py.File, name: str) -> None:
    data = file[name]
    layout = h5py.VirtualLayout(data.shape, data.dtype)
    if data.shape:
        layout[...] = h5py.VirtualSource("other.h5", "data", data.shape)
    del file[name]
    file.create_virtual_dataset(name, layout)


def filtered(file: h5py.File, name: str) -> None:
    values = file[name][()]
    if np.size(values) > 1:
        del file[name]
        file.create_dataset(name, data=values, compression="gzip")
    else:
        virtual(file, name)


def linked_out(file: h5py.File, name: str) -> None:
    del file[name]
    file[name] = h5py.ExternalLink("fifo.h5", "/data")


def linked(file: h5py.File, name: str) -> None:
    del file[name]
    file[name] = h5py.SoftLink(f"/{name}")


def doubled(file: h5py.File, name: str) -> None:
    file[f"{name}_again"] = file[name]


def in_a_circle(file: h5py.File, _: str) -> None:
    file.create_group("circle")["circle"] = file["/"]


def declared_only(file: h5py.File, name: str) -> None:
    data = file[name]
    shape, dtype = (10**8, *data.shape[1:]) if data.shape else (), data.dtype
    del file[name]
    file.create_dataset(name, shape, dtype, chunks=(1024, *data.shape[1:]) if data.shape else None)


LAYOUTS = (external, virtual, filtered, linked_out, linked, doubled, in_a_circle, declared_only)


def layout_spoilt(path: Path, rng: Rng) -> None:
    """A dataset that lies elsewhere, is a link, or is only declared, beside a pipe that nobody writes into."""
    pipe = path.parent / "fifo.h5"
    if not pipe.exists():
        os.mkfifo(pipe)
    with h5py.File(path, "r+") as file:
        LAYOUTS[int(rng.integers(len(LAYOUTS)))](file, str(rng.choice(list(datasets(file)))))
    sealed(path)


# How an artefact is spoilt, and whether what is left must be refused by whatever reads it.
OF_ARTEFACTS: dict[str, tuple[Callable[[Path, Rng], None], bool]] = {
    "bytes": (bytes_flipped, True),
    "cut": (cut, True),
    "structure": (metadata_flipped, False),
    "dataset": (dataset_spoilt, False),
    "attribute": (attribute_spoilt, False),
    "layout": (layout_spoilt, True),
}


def text_spoilt(text: str, rng: Rng) -> str:
    """Lines dropped, doubled, moved, with another value, or letters that do not belong."""
    lines = text.splitlines() or [""]
    for _ in range(int(rng.integers(1, 4))):
        i, j = (int(k) for k in rng.integers(0, len(lines), 2))
        what = int(rng.integers(6))
        if what == 0 and len(lines) > 1:
            del lines[i]
        elif what == 1:
            lines.insert(j, lines[i])
        elif what == 2:
            words = lines[i].split(" ")
            words[int(rng.integers(len(words)))] = str(rng.choice(NASTY))
            lines[i] = " ".join(words)
        elif what == 3:
            head, colon, _ = lines[i].partition(":")
            lines[i] = f"{head}{colon} {rng.choice(NASTY)}"
        elif what == 4:
            at = int(rng.integers(len(lines[i]) + 1))
            lines[i] = lines[i][:at] + chr(int(rng.integers(1, 0x3000))) + lines[i][at:]
        else:
            fields = lines[i].split(",")
            fields[int(rng.integers(len(fields)))] = str(rng.choice(NASTY))
            lines[i] = ",".join(fields)
        i = min(i, len(lines) - 1)
    return "\n".join(lines) + "\n"
