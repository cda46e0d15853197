"""The deformed surface as one OBJ or PLY file a frame."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.export.playback import Playback
from ldsim.mesh.surface import Surface

Array = NDArray[np.float64]
Triangles = NDArray[np.int32]


def write_obj_sequence(playback: Playback, folder: Path) -> None:
    """Write folder/<motion>-<space>_<number>.obj, metres."""
    _write_sequence(playback, folder, "obj", _obj)


def write_ply_sequence(playback: Playback, folder: Path) -> None:
    """Write folder/<motion>-<space>_<number>.ply, binary, float32, metres."""
    _write_sequence(playback, folder, "ply", _ply)


def _write_sequence(
    playback: Playback, folder: Path, suffix: str, content: Callable[[Array, Triangles], bytes]
) -> None:
    surface = Surface.of(playback.mesh)
    digits = len(str(playback.frames - 1))
    for frame in range(playback.frames):
        positions = (playback.mesh.vertices + playback.displacement(frame))[surface.vertices]
        path = folder / f"{playback.title}_{frame:0{digits}d}.{suffix}"
        path.write_bytes(content(positions, surface.triangles))


def _obj(positions: Array, triangles: Triangles) -> bytes:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in positions.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (triangles + 1).tolist()]
    return ("\n".join(lines) + "\n").encode("ascii")


def _ply(positions: Array, triangles: Triangles) -> bytes:
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(positions)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    return header.encode("ascii") + positions.astype("<f4").tobytes() + faces.tobytes()
