"""Files for ParaView: VTK's XML by meshio, deformed frame by frame; XDMF 3, whose one HDF5 file has the mesh but once.

XDMF holds the displacement of every frame for "Warp By Vector"; of VTK's, a .pvd gives each frame its time.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import meshio
import numpy as np

from ldsim.arrays import Array
from ldsim.export.playback import Playback
from ldsim.simulator.fields import FIELDS, VertexField

# What meshio and XDMF call the cells.
CELLS = {"tet4": ("tetra", "Tetrahedron"), "hex8": ("hexahedron", "Hexahedron")}


class Fields:
    """What every frame has besides its shape, at each vertex: displacement, m; energy density, J/m³; stress, Pa."""

    def __init__(self, playback: Playback) -> None:
        self._at_vertices = VertexField(playback.scene, np.arange(playback.mesh.n_vertices))

    def __call__(self, u: Array) -> dict[str, Array]:
        """Name → (n, 3) or (n,) at the displacement u; the stress is von Mises'."""
        return {"displacement": u} | {name: self._at_vertices(name, u) for name in FIELDS}


def write_vtu_series(playback: Playback, folder: Path) -> None:
    """Write folder/<motion>-<space>.pvd and one frames/<number>.vtu a frame: deformed positions, and fields."""
    (folder / "frames").mkdir()
    mesh, digits = playback.mesh, len(str(playback.frames - 1))
    cells, entries, fields = [(CELLS[mesh.cell_type][0], mesh.cells)], [], Fields(playback)
    for frame in range(playback.frames):
        name, u = f"frames/{frame:0{digits}d}.vtu", playback.displacement(frame)
        data = {name: values.astype("f4") for name, values in fields(u).items()}
        meshio.write(folder / name, meshio.Mesh(mesh.vertices + u, cells, point_data=data))
        entries.append(f'<DataSet timestep="{playback.time(frame):.9g}" part="0" file="{name}"/>')
    (folder / f"{playback.title}.pvd").write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">\n<Collection>\n'
        + "\n".join(entries)
        + "\n</Collection>\n</VTKFile>\n",
        encoding="ascii",
    )


def write_xdmf(playback: Playback, folder: Path) -> None:
    """Write folder/<motion>-<space>.xdmf and the .h5 of the same name that it refers to."""
    name, fields = f"{playback.title}.h5", Fields(playback)
    with h5py.File(folder / name, "w") as file:
        file["vertices"], file["cells"] = playback.mesh.vertices, playback.mesh.cells
        for frame in range(playback.frames):
            for field, values in fields(playback.displacement(frame)).items():
                file[f"{field}/{frame}"] = values.astype(np.float32)
    frames = "\n".join(_frame(playback, frame, name) for frame in range(playback.frames))
    (folder / f"{playback.title}.xdmf").write_text(
        '<?xml version="1.0"?>\n<Xdmf Version="3.0"><Domain>\n'
        f'<Grid Name="{playback.title}" GridType="Collection" CollectionType="Temporal">\n{frames}\n</Grid>\n'
        "</Domain></Xdmf>\n",
        encoding="ascii",
    )


def _frame(playback: Playback, frame: int, name: str) -> str:
    """One time's grid; all of them refer to the same vertices and cells."""
    n, (m, nodes) = playback.mesh.n_vertices, playback.mesh.cells.shape
    cells = _data("Int", 4, (m, nodes), f"{name}:/cells")
    vertices = _data("Float", 8, (n, 3), f"{name}:/vertices")
    shapes: dict[str, tuple[int, ...]] = {"displacement": (n, 3)} | dict.fromkeys(FIELDS, (n,))
    fields = "".join(
        f'<Attribute Name="{field}" AttributeType="{"Vector" if len(shape) == 2 else "Scalar"}" Center="Node">'
        f"{_data('Float', 4, shape, f'{name}:/{field}/{frame}')}</Attribute>"
        for field, shape in shapes.items()
    )
    return (
        f'<Grid Name="{frame}" GridType="Uniform"><Time Value="{playback.time(frame):.9g}"/>'
        f'<Topology TopologyType="{CELLS[playback.mesh.cell_type][1]}" NumberOfElements="{m}">{cells}</Topology>'
        f'<Geometry GeometryType="XYZ">{vertices}</Geometry>{fields}</Grid>'
    )


def _data(kind: str, precision: int, shape: tuple[int, ...], place: str) -> str:
    size = " ".join(map(str, shape))
    return f'<DataItem NumberType="{kind}" Precision="{precision}" Format="HDF" Dimensions="{size}">{place}</DataItem>'
