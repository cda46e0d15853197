"""The deformed surface as one OBJ or PLY file a frame, by meshio."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np

from ldsim.export.playback import Playback
from ldsim.mesh.surface import Surface


def write_surfaces(playback: Playback, folder: Path, suffix: str, **options: bool) -> None:
    """Write folder/<motion>-<space>_<number>.<suffix>, float32, metres.

    Args:
        options: of meshio's writer, such as binary.
    """
    surface, digits = Surface.of(playback.mesh), len(str(playback.frames - 1))
    for frame in range(playback.frames):
        positions = surface.rest + playback.displacement(frame)[surface.vertices]
        mesh = meshio.Mesh(positions.astype(np.float32), [("triangle", surface.triangles)])
        mesh.write(folder / f"{playback.title}_{frame:0{digits}d}.{suffix}", **options)
