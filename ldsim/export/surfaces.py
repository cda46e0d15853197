"""The deformed surface as one OBJ or PLY file a frame; a skin keeps its materials and textures in OBJ."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np

from ldsim.export.drawn import Drawn
from ldsim.export.playback import Playback
from ldsim.mesh.skin import Paint, Skin


def write_surfaces(playback: Playback, folder: Path, suffix: str, **options: bool) -> None:
    """Write folder/<motion>-<space>_<number>.<suffix>, float32, metres.

    Args:
        options: of meshio's writer, such as binary.

    Raises:
        MeshError: the skin lies far outside of the solid.
    """
    drawn, digits = playback.drawn, len(str(playback.frames - 1))
    painted = drawn.skin is not None and suffix == "obj"
    if drawn.skin is not None and painted:
        _write_materials(drawn.skin, folder)
    for frame in range(playback.frames):
        positions = (drawn.rest + drawn.moved(playback.displacement(frame))).astype(np.float32)
        file = folder / f"{playback.title}_{frame:0{digits}d}.{suffix}"
        if painted:
            _write_obj(drawn, positions, file)
        else:
            meshio.Mesh(positions, [("triangle", drawn.triangles)]).write(file, **options)


def _write_obj(drawn: Drawn, positions: np.ndarray, file: Path) -> None:
    """One frame: a group a part, with its material; viewers make the normals."""
    skin = drawn.skin
    assert skin is not None
    lines = ["mtllib surface.mtl", *(f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in positions.tolist())]
    if skin.uv is not None:
        lines += [f"vt {u:.9g} {1 - v:.9g}" for u, v in skin.uv.tolist()]
    corner = "{0}/{0}" if skin.uv is not None else "{0}"
    for number, (group, _) in enumerate(skin.parts):
        lines += [f"g {group or 'surface'}", f"usemtl {_label(number, skin)}"]
        for triangle in (drawn.triangles[skin.part == number] + 1).tolist():
            lines.append("f " + " ".join(corner.format(vertex) for vertex in triangle))
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_materials(skin: Skin, folder: Path) -> None:
    """surface.mtl and the pictures that it names."""
    folder.mkdir(exist_ok=True)
    lines: list[str] = []
    for number, (_, look) in enumerate(skin.parts):
        red, green, blue, alpha = look.colour
        lines += [f"newmtl {_label(number, skin)}", f"Kd {red:g} {green:g} {blue:g}", f"d {alpha:g}"]
        if look.texture:
            (folder / _picture(number, look)).write_bytes(look.texture)
            lines.append(f"map_Kd {_picture(number, look)}")
    (folder / "surface.mtl").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _label(number: int, skin: Skin) -> str:
    """A name without blanks that no other part has."""
    return f"{'_'.join(skin.parts[number][1].name.split())}_{number}"


def _picture(number: int, look: Paint) -> str:
    return f"texture_{number}{look.suffix}"
