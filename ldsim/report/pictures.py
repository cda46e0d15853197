"""The animation of a finished run, for readers without script or WebGL: full, linear and latent space side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.mesh.surface import surface_triangles
from ldsim.report.camera import look_at_broadside, upright
from ldsim.report.drawing import Movement, moving_pictures, webp
from ldsim.report.runs import displacements, reduced_runs, title
from ldsim.report.schema import ROLE_NAMES, ROLES
from ldsim.run import Run

# The animation: how long, its frames, its pixels across, its triangles and bytes at most.
ANIMATION_SECONDS = 2.0
ANIMATION_FRAMES = 40
ANIMATION_WIDTH = 1000
ANIMATION_TRIANGLES = 1_000_000
ANIMATION_BYTES = 1_000_000
FEWEST_FRAMES = 12
# A second; many viewers show no more.
ANIMATION_RATE = 50.0


@dataclass(frozen=True, eq=False)
class Picture:
    """A file name, a caption, and WebP bytes."""

    file: str
    caption: str
    data: bytes


def moving_picture(run: Run) -> Picture | None:
    """The motion that judges, around its largest displacement, in real time, without spaces that are lost in it.

    None where there are too few frames, or the file would be too large.
    """
    names = [name for name in run.motions if reduced_runs(run, name)]
    motion = max(names, key=lambda name: ROLES.index(run.motions[name].role), default=None)
    if motion is None or len(frames := _stretch(run, motion)) < FEWEST_FRAMES:
        return None
    turn = upright(run.scene.gravity)
    rest, h = run.scene.mesh.vertices @ turn.T, run.scene.time_step

    def positions(space: str) -> Array:
        return rest + displacements(run, space, motion)(frames, slice(None)) @ turn.T

    def movement(space: str, moved: Array) -> Movement:
        return Movement.pulled(title(run, space), moved, map(run.motions[motion].pulls, frames.tolist()), turn)

    full = positions("full")
    sequences = [movement("full", full)]
    for space in reduced_runs(run, motion):
        moved = positions(space)
        if (np.linalg.norm(moved - full, axis=-1) < run.scene.mesh.diagonal).all():
            sequences.append(movement(space, moved))
    view = look_at_broadside(rest, np.concatenate([each.positions for each in sequences]))
    pause = float(frames[1] - frames[0]) * h
    pictures = moving_pictures(sequences, surface_triangles(run.scene.mesh), view, ANIMATION_WIDTH)
    data = webp(list(pictures), pause)
    if len(data) > ANIMATION_BYTES:
        return None
    caption = (  # frame i is the state at (i + 1) h
        f"Motion {motion} ({ROLE_NAMES[run.motions[motion].role]}) around its largest pull, "
        f"{(frames[0] + 1) * h:.2f} s to {(frames[-1] + 1) * h:.2f} s in real time."
    )
    return Picture(f"{motion}.webp", caption, data)


def _stretch(run: Run, motion: str) -> Indices:
    """Evenly spaced frames around the largest displacement, as many as the surface's size allows."""
    moved = mean_displacement(run, motion)
    if moved is None:
        return np.empty(0, dtype=np.int64)
    panels = 1 + len(reduced_runs(run, motion))
    most = min(ANIMATION_FRAMES, ANIMATION_TRIANGLES // (panels * len(surface_triangles(run.scene.mesh))))
    length = min(round(ANIMATION_SECONDS / run.scene.time_step), len(moved))
    least = int(np.ceil(1 / (ANIMATION_RATE * run.scene.time_step) - 1e-9))
    stride = max(-(-length // max(most, 1)), least, 1)
    first = int(np.clip(int(moved.argmax()) - length // 2, 0, len(moved) - length))
    return np.arange(first, first + length, stride, dtype=np.int64)[:most]


def mean_displacement(run: Run, motion: str) -> Array | None:
    """Mean vertex displacement of the full space in each frame, (N,) metres, where a reduced run recorded it."""
    known = (trajectory.mean_displacement for trajectory in reduced_runs(run, motion).values())
    return next((moved for moved in known if moved is not None and len(moved)), None)
