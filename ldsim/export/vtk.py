"""VTK's XML files for ParaView: one .vtu a frame, by meshio, and a .pvd that gives each its time."""

from __future__ import annotations

from pathlib import Path

import meshio

from ldsim.export.playback import Playback

CELLS = {"tet4": "tetra", "hex8": "hexahedron"}


def write_vtu_series(playback: Playback, folder: Path) -> None:
    """Write folder/<motion>-<space>.pvd and one frames/<number>.vtu a frame: deformed positions, displacements."""
    (folder / "frames").mkdir()
    mesh, digits = playback.mesh, len(str(playback.frames - 1))
    cells, entries = [(CELLS[mesh.cell_type], mesh.cells)], []
    for frame in range(playback.frames):
        name, u = f"frames/{frame:0{digits}d}.vtu", playback.displacement(frame)
        data = {"displacement": u.astype("f4")}
        meshio.write(folder / name, meshio.Mesh(mesh.vertices + u, cells, point_data=data))
        entries.append(f'<DataSet timestep="{playback.time(frame):.9g}" part="0" file="{name}"/>')
    (folder / f"{playback.title}.pvd").write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">\n<Collection>\n'
        + "\n".join(entries)
        + "\n</Collection>\n</VTKFile>\n",
        encoding="ascii",
    )
