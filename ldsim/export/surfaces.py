"""The deformed surface as one OBJ or PLY file a frame, by meshio."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np

from ldsim.export.playback import Playback
from ldsim.mesh.surface import Surface


def write_obj_sequence(playback: Playback, folder: Path) -> None:
    """Write folder/<motion>-<space>_<number>.obj, metres."""
    _write_sequence(playback, folder, "obj")


def write_ply_sequence(playback: Playback, folder: Path) -> None:
    """Write folder/<motion>-<space>_<number>.ply, binary, float32, metres."""
    _write_sequence(playback, folder, "ply", binary=True)


def _write_sequence(playback: Playback, folder: Path, suffix: str, **options: bool) -> None:
    surface, digits = Surface.of(playback.mesh), len(str(playback.frames - 1))
    for frame in range(playback.frames):
        positions = surface.rest + playback.displacement(frame)[surface.vertices]
        mesh = meshio.Mesh(positions.astype(np.float32), [("triangle", surface.triangles)])
        mesh.write(folder / f"{playback.title}_{frame:0{digits}d}.{suffix}", **options)
