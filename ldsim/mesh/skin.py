"""A surface as an artist made it: triangles with texture coordinates, normals, materials and groups."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.errors import MeshError


@dataclass(frozen=True, eq=False)
class Paint:
    """What a part of a surface is painted with.

    Attributes:
        colour: red, green, blue and opacity, linear, 0 … 1; times the texture.
        texture: the bytes of a picture file, and the suffix of its name, ".png" or ".jpg"; empty where there is none.
        metallic, roughness: 0 … 1.
    """

    name: str
    colour: tuple[float, float, float, float] = (0.8, 0.8, 0.8, 1.0)
    texture: bytes = b""
    suffix: str = ""
    metallic: float = 0.0
    roughness: float = 0.6


@dataclass(frozen=True, eq=False)
class Skin:
    """Corners that share a place but not a texture coordinate or a normal are vertices of their own.

    Attributes:
        positions: (v, 3) float64.
        triangles: (t, 3) int64.
        uv: (v, 2) float64, v down the picture as in glTF; None where the file gives none.
        normals: (v, 3) float64, unit; None where the file gives none.
        part: of each triangle the number of its part, (t,) int64.
        parts: name and look of each.
    """

    positions: Array
    triangles: Indices
    uv: Array | None
    normals: Array | None
    part: Indices
    parts: tuple[tuple[str, Paint], ...]

    def __post_init__(self) -> None:
        n = len(self.positions)
        if not len(self.triangles):
            raise MeshError("the surface has no triangles")
        if not np.isfinite(self.positions).all():
            raise MeshError("a vertex of the surface is not finite")
        if self.triangles.min() < 0 or self.triangles.max() >= n:
            raise MeshError(f"a triangle has the vertex {self.triangles.max()}; the surface has {n}")
        for what in (self.uv, self.normals):
            if what is not None and (len(what) != n or not np.isfinite(what).all()):
                raise MeshError("texture coordinates or normals of the surface are missing or not finite")


@dataclass
class _Obj:
    """What an OBJ file has said so far."""

    numbers: dict[str, list[list[float]]] = field(default_factory=lambda: {"v": [], "vt": [], "vn": []})
    corners: dict[tuple[int, int, int], int] = field(default_factory=dict)
    triangles: list[list[int]] = field(default_factory=list)
    part: list[int] = field(default_factory=list)
    names: dict[tuple[str, str], int] = field(default_factory=dict)
    looks: dict[str, Paint] = field(default_factory=dict)


def read_obj(path: Path) -> Skin:
    """Read an OBJ file and the materials beside it; groups with a material each are its parts.

    Raises:
        MeshError: it cannot be read, or is no surface; the message names the line.
    """
    said, group, material = _Obj(), "", ""
    for number, (word, rest) in _lines(path):
        try:
            if word in said.numbers:
                said.numbers[word].append(_numbers(rest, 2 if word == "vt" else 3))
            elif word in ("g", "o"):
                group = rest
            elif word == "usemtl":
                material = rest
            elif word == "mtllib":
                said.looks |= _materials(path, rest)
            elif word == "f":
                _add_face(said, rest.split(), said.names.setdefault((group, material), len(said.names)))
        except (ValueError, IndexError, OSError) as error:
            raise MeshError(f"{path}, line {number}: {word} {rest!r} is not understood ({error})") from error
    return _skin_of(said)


def _numbers(rest: str, count: int) -> list[float]:
    found = [float(value) for value in rest.split()[:count]]
    if len(found) < count:
        raise ValueError(f"{len(found)} numbers, {count} are needed")
    return found


def _add_face(said: _Obj, words: list[str], part: int) -> None:
    """A polygon, cut into a fan of triangles; indices count from 1, or back from the last one."""
    corners = []
    for word in words:
        index = [int(text) if text else 0 for text in (*word.split("/"), "", "")[:3]]
        counts = [len(said.numbers[kind]) for kind in ("v", "vt", "vn")]
        v, t, n = (i + count if i < 0 else i - 1 for i, count in zip(index, counts, strict=True))
        if not (0 <= v < counts[0] and t < counts[1] and n < counts[2]):
            raise IndexError(f"there is no corner {word}")
        corners.append(said.corners.setdefault((v, t, n), len(said.corners)))
    for i in range(1, len(corners) - 1):
        said.triangles.append([corners[0], corners[i], corners[i + 1]])
        said.part.append(part)


def _skin_of(said: _Obj) -> Skin:
    v, t, n = np.array(list(said.corners), dtype=np.int64).reshape(-1, 3).T
    numbers = {kind: np.array(values, dtype=np.float64) for kind, values in said.numbers.items()}
    uv = numbers["vt"][t] * [1.0, -1.0] + [0.0, 1.0] if len(t) and t.min() >= 0 else None
    normals = _units(numbers["vn"][n]) if len(n) and n.min() >= 0 else None
    parts = tuple((group, said.looks.get(name, Paint(name or "surface"))) for group, name in said.names)
    triangles = np.array(said.triangles, dtype=np.int64).reshape(-1, 3)
    return Skin(numbers["v"].reshape(-1, 3)[v], triangles, uv, normals, np.array(said.part, dtype=np.int64), parts)


def _units(normals: Array) -> Array | None:
    """Of unit length, which OBJ does not ask for; None where one has no direction, so that the triangles give all."""
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / lengths if lengths.min() > 0 else None


def _share(number: float) -> float:
    """A colour's share, between 0 and 1."""
    return min(1.0, max(0.0, number))


def _below(folder: Path, file: Path, name: str) -> Path | None:
    """What a file names, where it lies in a folder or below: nobody's surface draws in what else is on this machine."""
    place = Path(os.path.abspath(file.parent / name.replace("\\", "/")))
    return place if place.is_relative_to(os.path.abspath(folder)) and place.is_file() else None


def _materials(obj: Path, library: str) -> dict[str, Paint]:
    """The looks of the MTL file that an OBJ file names; what is not there leaves a plain one."""
    found: dict[str, Paint] = {}
    path, name = _below(obj.parent, obj, library), ""
    if path is None:
        return found
    for _, (word, rest) in _lines(path):
        if word == "newmtl":
            name, found[rest] = rest, Paint(rest)
        elif word == "Kd" and name:
            red, green, blue = map(_share, _numbers(rest, 3))
            found[name] = replace(found[name], colour=(red, green, blue, found[name].colour[3]))
        elif word == "d" and name:
            found[name] = replace(found[name], colour=(*found[name].colour[:3], _share(float(rest.split()[0]))))
        elif word == "map_Kd" and name:
            picture = _below(obj.parent, path, rest.split()[-1])
            if picture is not None:
                found[name] = replace(found[name], texture=picture.read_bytes(), suffix=picture.suffix.lower())
    return found


def _lines(path: Path) -> Iterator[tuple[int, tuple[str, str]]]:
    """Number, first word and rest of each line that says something."""
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise MeshError(f"{path} cannot be read: {error}") from error
    for number, line in enumerate(text.splitlines(), 1):
        word, rest = (*line.partition("#")[0].split(maxsplit=1), "", "")[:2]
        if word:
            yield number, (word, rest.strip())
