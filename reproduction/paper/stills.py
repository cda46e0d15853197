"""A frame of a motion in several spaces, side by side, as the paper's pictures show it."""

from __future__ import annotations

import io
from collections.abc import Mapping

import numpy as np

from ldsim.arrays import Array
from ldsim.mechanics.scene import Scene
from ldsim.mesh.surface import surface_triangles
from ldsim.report.camera import limits_of, look_at_broadside, upright
from ldsim.report.drawing import DrawnPose, side_by_side
from ldsim.run import Run

WIDTH = 900


def farthest_frame(run: Run, motion: str) -> tuple[int, Array]:
    """The frame of a motion in which the full space has moved most, and its displacement, (n, 3) metres."""
    read, frames, found = run.played.reader(motion), run.played.frames(motion), (-1, np.zeros((0, 3)))
    most = -1.0
    for frame in range(frames):
        u = np.asarray(read(frame, frame + 1)[0], dtype=np.float64).reshape(-1, 3)
        moved = float(np.linalg.norm(u, axis=1).mean())
        if moved > most:
            most, found = moved, (frame, u)
    return found


def still(scene: Scene, poses: Mapping[str, Array]) -> bytes:
    """Displacements (n, 3), metres, by their titles, as one picture, WebP; a lost one is left out.

    Vertices are coloured by their distance to the first.
    """
    turn = upright(scene.gravity)
    rest = scene.mesh.vertices
    drawn = [DrawnPose(title, (rest + u) @ turn.T) for title, u in poses.items() if np.isfinite(u).all()]
    everything = np.stack([pose.positions for pose in drawn])
    view = look_at_broadside(rest @ turn.T, everything)
    limits = limits_of(view, everything.reshape(-1, 3))
    most = float(np.linalg.norm(everything - everything[0], axis=2).max())
    data = io.BytesIO()
    side_by_side(drawn, surface_triangles(scene.mesh), view, limits, WIDTH, most).save(data, "WEBP", quality=80)
    return data.getvalue()
