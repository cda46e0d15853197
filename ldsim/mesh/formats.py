"""Mesh files: every format that meshio knows, read into a `Mesh` or into `Triangles`, or refused in one line."""

from __future__ import annotations

import contextlib
import io
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np

from ldsim.errors import MeshError
from ldsim.mesh.mesh import Mesh, without_unused_vertices
from ldsim.mesh.triangles import Triangles

CELL_TYPES = {"tetra": "tet4", "hexahedron": "hex8"}
MESHIO_TYPES = {ours: theirs for theirs, ours in CELL_TYPES.items()}
SURFACE_CUTS = {"triangle": [[0, 1, 2]], "quad": [[0, 1, 2], [0, 2, 3]]}
COMMON_EXTENSIONS = ".mesh, .msh, .vtk, .vtu, .inp, .xdmf"


@dataclass(frozen=True, eq=False)
class MeshFile:
    """What a mesh file held.

    Attributes:
        mesh: the volume mesh, vertices that no cell uses left out.
        dropped_vertices: how many those were.
    """

    mesh: Mesh
    dropped_vertices: int


def read_mesh(path: str | Path, scale: float = 1.0) -> MeshFile:
    """Read the tetrahedra or hexahedra of a mesh file; cells of lower dimension in it are ignored.

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
        mesh = Mesh(np.asarray(raw.points, dtype=np.float64) * scale, cells, kind)
    used = without_unused_vertices(mesh)
    return MeshFile(used, mesh.n_vertices - used.n_vertices)


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


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the file's name in front of what is wrong with its mesh."""
    try:
        yield
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error


def write_mesh(path: str | Path, mesh: Mesh) -> None:
    """Write a mesh, in metres, in the format that the extension names.

    Raises:
        MeshError: the extension is unknown or the file cannot be written.
    """
    path = Path(path)
    _check_extension(path)
    with _quiet(), _as_mesh_error(path, "cannot be written"):
        meshio.Mesh(mesh.vertices, [(MESHIO_TYPES[mesh.cell_type], mesh.cells)]).write(path)


def _check_scale(path: Path, scale: float) -> None:
    if not (math.isfinite(scale) and scale > 0):
        raise MeshError(f"scale is {scale}; it must be a positive number of metres per unit of {path}")


def _check_path(path: Path) -> None:
    if path.is_dir():
        raise MeshError(f"{path} is a directory; expected a mesh file")
    if not path.is_file():
        raise MeshError(f"mesh file {path} does not exist; check the path (mesh.file)")
    _check_extension(path)
    if path.stat().st_size == 0:
        raise MeshError(f"mesh file {path} is empty")


def _check_extension(path: Path) -> None:
    if path.suffix.lower() not in meshio.extension_to_filetypes:
        raise MeshError(f"{path} has the unknown extension {path.suffix!r}; allowed are {COMMON_EXTENSIONS} and others")


def _read_raw(path: Path) -> meshio.Mesh:
    _check_path(path)
    hint = "; it may be truncated or of another format"
    with _quiet() as said, _as_mesh_error(path, f"is not a readable {path.suffix} file", hint, said):
        return meshio.read(path)


@contextlib.contextmanager
def _quiet() -> Iterator[io.StringIO]:
    """Catch what meshio and the packages below it print; yields what they said."""
    said = io.StringIO()
    with warnings.catch_warnings(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
        warnings.simplefilter("ignore")
        yield said


@contextlib.contextmanager
def _as_mesh_error(path: Path, what: str, hint: str = "", said: io.StringIO | None = None) -> Iterator[None]:
    """Turn anything that meshio fails with into a `MeshError`: an exit, or its parsers' own errors."""
    try:
        yield
    except (Exception, SystemExit) as error:
        words = said.getvalue() if said is not None and isinstance(error, SystemExit) else str(error)
        reason = " ".join(words.split()) or type(error).__name__
        raise MeshError(f"{path} {what} ({reason}){hint}") from error


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
