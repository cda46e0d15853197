"""XDMF 3 with HDF5: the mesh once, the displacement of every frame, for ParaView's "Warp By Vector"."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from ldsim.export.source import Playback

TOPOLOGY = {"tet4": "Tetrahedron", "hex8": "Hexahedron"}


def write_xdmf(playback: Playback, folder: Path) -> None:
    """Write folder/<motion>-<space>.xdmf and the .h5 of the same name that it refers to."""
    mesh, name = playback.mesh, f"{playback.title}.h5"
    with h5py.File(folder / name, "w") as file:
        file["vertices"], file["cells"] = mesh.vertices, mesh.cells
        for frame in range(playback.frames):
            file[f"displacement/{frame}"] = playback.displacement(frame).astype(np.float32)
    n, (m, nodes) = mesh.n_vertices, mesh.cells.shape
    topology = (
        f'<Topology TopologyType="{TOPOLOGY[mesh.cell_type]}" NumberOfElements="{m}">'
        f'<DataItem DataType="Int" Precision="4" Format="HDF" Dimensions="{m} {nodes}">{name}:/cells</DataItem>'
        "</Topology>"
    )
    geometry = (
        '<Geometry GeometryType="XYZ">'
        f'<DataItem DataType="Float" Precision="8" Format="HDF" Dimensions="{n} 3">{name}:/vertices</DataItem>'
        "</Geometry>"
    )
    frames = "\n".join(_frame(playback, frame, name) for frame in range(playback.frames))
    (folder / f"{playback.title}.xdmf").write_text(
        '<?xml version="1.0"?>\n<Xdmf Version="3.0" xmlns:xi="http://www.w3.org/2001/XInclude"><Domain>\n'
        f'<Grid Name="mesh" GridType="Uniform">{topology}{geometry}</Grid>\n'
        f'<Grid Name="motion" GridType="Collection" CollectionType="Temporal">\n{frames}\n</Grid>\n'
        "</Domain></Xdmf>\n",
        encoding="ascii",
    )


def _frame(playback: Playback, frame: int, name: str) -> str:
    mesh = "xpointer(//Grid[@Name=&quot;mesh&quot;]/*[self::Topology or self::Geometry])"
    return (
        f'<Grid Name="frame {frame}"><xi:include xpointer="{mesh}"/><Time Value="{playback.time(frame):.9g}"/>'
        '<Attribute Name="displacement" AttributeType="Vector" Center="Node">'
        f'<DataItem DataType="Float" Precision="4" Format="HDF" Dimensions="{playback.mesh.n_vertices} 3">'
        f"{name}:/displacement/{frame}</DataItem></Attribute></Grid>"
    )
