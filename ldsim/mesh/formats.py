"""Mesh files: every format that meshio knows, read into a `Mesh` or into `Triangles`, or refused in one line."""

from __future__ import annotations

import contextlib
import io
import math
import os
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
from numpy.typing import ArrayLike

from ldsim.arrays import Array, Indices
from ldsim.errors import MeshError
from ldsim.mesh.gltf_file import files_of_gltf, read_gltf
from ldsim.mesh.mesh import Group, Mesh, without_unused_vertices
from ldsim.mesh.skin import Paint, Skin, read_obj
from ldsim.mesh.triangles import Triangles

CELL_TYPES = {"tetra": "tet4", "hexahedron": "hex8"}
# Numbers that formats mark their entities with, and what entities of each dimension are called.
TAGS = ("gmsh:physical", "medit:ref")
ENTITIES = ("points", "edges", "faces", "cells")
SURFACE_CUTS = {"triangle": [[0, 1, 2]], "quad": [[0, 1, 2], [0, 2, 3]]}
# Read here, with what they are painted with.
PAINTED = (".obj", ".glb", ".gltf")
# Formats with a part of their numbers in a second file, and where that is not named in the first, what it is called.
XDMF, PAIRS = (".xdmf", ".xmf"), {".ele": ".node", ".node": ".ele"}
COMMON_EXTENSIONS = ".mesh, .msh, .vtk, .vtu, .inp, .xdmf"


@dataclass(frozen=True, eq=False)
class MeshFile:
    """What a mesh file held.

    Attributes:
        mesh: the volume mesh, vertices that no cell uses left out.
        dropped_vertices: how many those were.
        cell_data: numbers the file gives to its cells, (m,) float64 each.
    """

    mesh: Mesh
    dropped_vertices: int
    cell_data: Mapping[str, Array] = field(default_factory=dict)


def read_mesh(path: str | Path, scale: float = 1.0) -> MeshFile:
    """Read the tetrahedra or hexahedra of a mesh file; cells of lower dimension in it serve its groups alone.

    Sets and physical groups keep their names. A part that has but a number is called after what it is of: cells_3,
    faces_3, edges_3 or points_3; the number 0 marks no part.

    Args:
        path: the format follows from the extension.
        scale: metres per unit of the file.

    Raises:
        MeshError: the file is missing, unreadable or of an unknown format, holds no volume cells or more than one
            type of them, or its numbers are no mesh; the message names the file.
    """
    path = Path(path)
    _check_scale(path, scale)
    raw = _read_raw(path)
    kind, cells = _volume_cells(path, raw)
    with naming(path):
        mesh = Mesh(np.asarray(raw.points, dtype=np.float64) * scale, cells, kind, _groups(raw))
    used = without_unused_vertices(mesh)
    return MeshFile(used, mesh.n_vertices - used.n_vertices, _cell_data(raw))


def read_surface(path: str | Path, scale: float = 1.0) -> Triangles:
    """Read the triangles of a surface file, as they are; quadrilaterals are cut in two, lines and points ignored.

    Args:
        path: the format follows from the extension.
        scale: metres per unit of the file.

    Raises:
        MeshError: the file is missing, unreadable or of an unknown format, holds volume cells, larger polygons or no
            triangles, or its numbers are no surface; the message names the file.
    """
    path = Path(path)
    _check_scale(path, scale)
    if path.suffix.lower() in PAINTED:
        skin = read_skin(path, scale)  # where texture coordinates part, so do its vertices: what is one place is joined
        places, number = np.unique(skin.positions, axis=0, return_inverse=True)
        with naming(path):
            return Triangles(places, number[skin.triangles])
    raw = _read_raw(path)
    other = sorted({block.type for block in raw.cells if block.dim > 1 and block.type not in SURFACE_CUTS})
    if other:
        raise MeshError(
            f"{path} holds cells of the type {', '.join(other)}; a surface may have {' and '.join(SURFACE_CUTS)}s"
            + (" (a volume mesh is read with mesh.file)" if set(other) & set(CELL_TYPES) else "")
        )
    blocks = [block.data[:, SURFACE_CUTS[block.type]].reshape(-1, 3) for block in raw.cells if block.dim == 2]
    if sum(map(len, blocks)) == 0:
        raise MeshError(f"{path} holds no triangles; expected a closed triangle surface")
    with naming(path):
        return Triangles(np.asarray(raw.points, dtype=np.float64) * scale, np.concatenate(blocks).astype(np.int64))


def read_skin(path: str | Path, scale: float = 1.0) -> Skin:
    """Read a surface as it is painted: .glb, .gltf or .obj with texture, another format without.

    Raises:
        MeshError: as of `read_surface`.
    """
    path = Path(path)
    _check_scale(path, scale)
    if path.suffix.lower() in PAINTED:
        _check_path(path)
        with naming(path):
            skin = read_obj(path) if path.suffix.lower() == ".obj" else read_gltf(path)
        return replace(skin, positions=skin.positions * scale)
    read = read_surface(path, scale)
    part = np.zeros(len(read.faces), dtype=np.int64)
    return Skin(read.vertices, read.faces, None, None, part, ((path.stem, Paint("surface")),))


def companions(path: Path) -> list[Path]:
    """The other files that a mesh file is read with, as far as they are there: what they hold is the mesh too."""
    suffix = path.suffix.lower()
    if suffix in PAIRS:
        names = [path.with_suffix(PAIRS[suffix]).name]
    elif suffix in XDMF:
        names = _files_of_xdmf(path)
    else:
        names = files_of_gltf(path) if suffix == ".gltf" else []
    places = sorted({path.parent / name for name in names})
    return [place for place in places if os.path.isfile(place) and os.access(place, os.R_OK)]  # any name may be asked


def _files_of_xdmf(path: Path) -> list[str]:
    try:
        items = list(ElementTree.parse(path).iter("DataItem"))
    except (ElementTree.ParseError, OSError, ValueError):  # whoever reads the mesh says so
        return []
    texts = [item.text or "" for item in items if item.get("Format") in ("HDF", "Binary")]
    return [text.strip().partition(":")[0] for text in texts]  # of HDF what follows is a dataset


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the file's name in front of what is wrong with its mesh."""
    try:
        yield
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error


def _check_scale(path: Path, scale: float) -> None:
    if not (math.isfinite(scale) and scale > 0):
        raise MeshError(f"scale is {scale}; it must be a positive number of metres per unit of {path}")


def _check_path(path: Path) -> None:
    if path.is_dir():
        raise MeshError(f"{path} is a directory; expected a mesh file")
    if not path.is_file():
        raise MeshError(f"mesh file {path} does not exist; check the path (mesh.file)")
    if path.suffix.lower() not in (*meshio.extension_to_filetypes, *PAINTED):
        raise MeshError(f"{path} has the unknown extension {path.suffix!r}; allowed are {COMMON_EXTENSIONS} and others")
    if path.stat().st_size == 0:
        raise MeshError(f"mesh file {path} is empty")


def _read_raw(path: Path) -> meshio.Mesh:
    """What meshio reads; anything that it or the packages below it fail with, an exit too, becomes a `MeshError`."""
    _check_path(path)
    said = io.StringIO()
    with warnings.catch_warnings(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
        warnings.simplefilter("ignore")
        try:
            return meshio.read(path)
        except (Exception, SystemExit) as error:
            words = said.getvalue() if isinstance(error, SystemExit) else str(error)
            reason = " ".join(words.split()) or type(error).__name__
            hint = "it may be truncated or of another format"
            raise MeshError(f"{path} is not a readable {path.suffix} file ({reason}); {hint}") from error


def _volume_cells(path: Path, raw: meshio.Mesh) -> tuple[str, np.ndarray]:
    """The cell type and the (m, nodes) cells of the one supported volume type that the file holds."""
    counts: dict[str, int] = {}
    for block in raw.cells:
        counts[block.type] = counts.get(block.type, 0) + len(block.data)
    volume = sorted({block.type for block in raw.cells if block.dim == 3 and len(block.data)})
    found = ", ".join(f"{count} {name}" for name, count in counts.items() if count) or "no cells at all"
    if not volume:
        raise MeshError(
            f"{path} holds no tetrahedra or hexahedra but {found}; a closed surface is read with mesh.surface"
        )
    if len(volume) > 1:
        raise MeshError(f"{path} mixes volume cells ({found}); expected tetra alone or hexahedron alone")
    if volume[0] not in CELL_TYPES:
        raise MeshError(f"{path} holds {found}; allowed volume cells are {', '.join(CELL_TYPES)} (linear ones)")
    cells = np.concatenate([block.data for block in raw.cells if block.type == volume[0] and len(block.data)])
    return CELL_TYPES[volume[0]], cells


def _groups(raw: meshio.Mesh) -> dict[str, Group]:
    """The named and the numbered parts of a file."""
    parts: dict[str, list[Group]] = {}
    first_cells = np.cumsum([0, *(len(block.data) if block.dim == 3 else 0 for block in raw.cells)])
    for i, block in enumerate(raw.cells):
        for name, members in _members(raw, i, block).items():
            cells = first_cells[i] + members if block.dim == 3 else np.empty(0, dtype=np.int64)
            parts.setdefault(_group_name(name), []).append(Group(np.unique(block.data[members]), cells))
    for name, vertices in _point_parts(raw).items():
        parts.setdefault(_group_name(name), []).append(Group(vertices, np.empty(0, dtype=np.int64)))
    groups = {name: _union(found) for name, found in sorted(parts.items())}
    return {name: group for name, group in groups.items() if len(group.vertices)}


def _group_name(name: str) -> str:
    """One that HDF5 can keep; parts whose names become the same are one group."""
    kept = name.replace("/", "_").replace("\0", "_")
    return "unnamed" if kept in ("", ".") else kept


def _members(raw: meshio.Mesh, i: int, block: meshio.CellBlock) -> dict[str, Indices]:
    """The entities of block `i` that belong to each part: sets by name, tags by name or number."""
    sets = {name: indices[i] for name, indices in raw.cell_sets.items() if not name.startswith("gmsh:")}
    members = {name: np.asarray(found, dtype=np.int64) for name, found in sets.items() if found is not None}
    for key in TAGS:
        tags = _tags(raw.cell_data[key][i] if key in raw.cell_data else ())
        for tag in np.unique(tags[tags != 0]):
            name = _tag_name(raw, block.dim, int(tag)) if key == TAGS[0] else f"{ENTITIES[block.dim]}_{int(tag)}"
            members.setdefault(name, np.flatnonzero(tags == tag))
    return {name: found for name, found in members.items() if len(found)}


def _tags(values: ArrayLike) -> Array:
    """The numbers of parts, one for each entity; data of another kind by the same name tell of none."""
    tags = np.asarray(values)
    return tags if tags.ndim == 1 and tags.dtype.kind in "iuf" and np.isfinite(tags).all() else np.zeros(0)


def _tag_name(raw: meshio.Mesh, dim: int, tag: int) -> str:
    """The name that a Gmsh file gives to a physical group, or one made of its number."""
    names = [name for name, value in raw.field_data.items() if list(value) == [tag, dim]]
    return names[0] if names else f"{ENTITIES[dim]}_{tag}"


def _point_parts(raw: meshio.Mesh) -> dict[str, Indices]:
    """The vertices of each set of points, and of each number that points are marked with."""
    parts = {name: np.unique(np.asarray(found, dtype=np.int64)) for name, found in raw.point_sets.items()}
    tags = _tags(raw.point_data.get("medit:ref", ()))
    return parts | {f"points_{int(tag)}": np.flatnonzero(tags == tag) for tag in np.unique(tags[tags != 0])}


def _union(parts: list[Group]) -> Group:
    vertices = np.unique(np.concatenate([part.vertices for part in parts]))
    cells = np.unique(np.concatenate([part.cells for part in parts]))
    return Group(vertices.astype(np.int64), cells.astype(np.int64))


def _cell_data(raw: meshio.Mesh) -> dict[str, Array]:
    """The scalars of the volume cells, by name, in the order of the mesh's cells."""
    volume = [i for i, block in enumerate(raw.cells) if block.dim == 3 and len(block.data)]
    columns = {name: [np.asarray(data[i]) for i in volume] for name, data in raw.cell_data.items()}
    return {
        name: np.concatenate(parts).astype(np.float64)
        for name, parts in columns.items()
        if all(part.ndim == 1 and part.dtype.kind in "fiu" for part in parts)
    }
