"""VTK's XML files for ParaView: one .vtu a frame and a .pvd that gives each its time (VTK file formats, XML).

Arrays are written as base64 of their bytes behind a UInt64 count; positions are deformed, the displacement is a field.
"""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.export.playback import Playback

VTK_CELL = {"tet4": 10, "hex8": 12}
TYPE_NAMES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}


def write_vtu_series(playback: Playback, folder: Path) -> None:
    """Write folder/<motion>-<space>.pvd and one frames/<number>.vtu a frame."""
    (folder / "frames").mkdir()
    digits = len(str(playback.frames - 1))
    cells = _cells(playback)
    entries = []
    for frame in range(playback.frames):
        name = f"frames/{frame:0{digits}d}.vtu"
        (folder / name).write_text(_vtu(playback, frame, cells), encoding="ascii")
        entries.append(f'    <DataSet timestep="{playback.time(frame):.9g}" part="0" file="{name}"/>')
    collection = "\n".join(["  <Collection>", *entries, "  </Collection>"])
    (folder / f"{playback.title}.pvd").write_text(_file("Collection", collection), encoding="ascii")


def _vtu(playback: Playback, frame: int, cells: str) -> str:
    mesh, u = playback.mesh, playback.displacement(frame)
    return _file(
        "UnstructuredGrid",
        f'  <UnstructuredGrid>\n  <Piece NumberOfPoints="{mesh.n_vertices}" NumberOfCells="{mesh.n_cells}">\n'
        f'  <PointData Vectors="displacement">\n{_array("displacement", u.astype("f4"))}\n  </PointData>\n'
        f"  <Points>\n{_array('Points', mesh.vertices + u)}\n  </Points>\n{cells}\n"
        "  </Piece>\n  </UnstructuredGrid>",
    )


def _cells(playback: Playback) -> str:
    """The cells, the same text in every frame."""
    cells = playback.mesh.cells
    offsets = np.arange(1, len(cells) + 1, dtype=np.int64) * cells.shape[1]
    types = np.full(len(cells), VTK_CELL[playback.mesh.cell_type], dtype=np.uint8)
    arrays = (("connectivity", cells.astype(np.int64).ravel()), ("offsets", offsets), ("types", types))
    return "\n".join(["  <Cells>", *(_array(name, values) for name, values in arrays), "  </Cells>"])


def _array(name: str, values: NDArray[np.generic]) -> str:
    """A DataArray element of (n,) or (n, 3) values."""
    little = np.ascontiguousarray(values.astype(values.dtype.newbyteorder("<"), copy=False)).tobytes()
    text = base64.b64encode(len(little).to_bytes(8, "little") + little).decode("ascii")
    kind = TYPE_NAMES[values.dtype.str[1:]]
    components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    return f'  <DataArray type="{kind}" Name="{name}"{components} format="binary">{text}</DataArray>'


def _file(kind: str, content: str) -> str:
    return (
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f"{content}\n</VTKFile>\n"
    )
