"""The pictures of a finished run: full space beside the linear and the latent one, still and moving."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.mesh.surface import surface_triangles
from ldsim.report.camera import limits_of, look_at_broadside, upright
from ldsim.report.drawing import animation, png, side_by_side
from ldsim.report.runs import displacements, reduced_runs, title
from ldsim.report.schema import MM_PER_M, ROLE_NAMES
from ldsim.report.wording import readable
from ldsim.run import Run

# The animation: how long, its frames, its pixels across, its triangles and bytes at most.
ANIMATION_SECONDS = 2.0
ANIMATION_FRAMES = 40
ANIMATION_WIDTH = 1000
ANIMATION_TRIANGLES = 1_000_000
ANIMATION_BYTES = 1_000_000
FEWEST_FRAMES = 12


@dataclass(frozen=True, eq=False)
class Picture:
    """A file name, a caption, and PNG or WebP bytes."""

    file: str
    caption: str
    data: bytes


@dataclass(frozen=True)
class Moment:
    """A frame of a motion."""

    motion: str
    frame: int


class Studio:
    """Draws frames of a run, all by one camera.

    Args:
        run: the run; its snapshots must stay open.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._turn = upright(run.scene.gravity)
        self._rest = run.scene.mesh.vertices @ self._turn.T
        self._triangles = surface_triangles(run.scene.mesh)

    def still(self, moment: Moment) -> Picture:
        """One frame of all spaces; a space that is lost by then is left out and named in the caption."""
        at = np.array([moment.frame])
        full = self._positions("full", moment.motion, at)[0]
        poses, remarks, framed = [(title(self._run, "full"), full)], [], [full]
        for space, trajectory in reduced_runs(self._run, moment.motion).items():
            reduced = self._positions(space, moment.motion, at)[0]
            if not np.isfinite(reduced).all():
                remarks.append(f"{space} has diverged")
                continue
            poses.append((title(self._run, space), reduced))
            framed += [reduced] if self._near(reduced, full) else []
            if trajectory.mean_error is not None:
                remarks.append(f"{space} {readable(MM_PER_M * float(trajectory.mean_error[moment.frame]))} mm")
        view = look_at_broadside(self._rest, np.stack(framed))
        data = png(side_by_side(poses, self._triangles, full, view, limits_of(view, np.stack(framed))))
        caption = f"{self._motion_words(moment.motion)} at {self._seconds(moment.frame):.2f} s"
        caption += f"; mean distance to full space: {', '.join(remarks)}." if remarks else "."
        return Picture(f"{moment.motion}_{moment.frame:05d}.png", caption, data)

    def moving(self, motion: str) -> Picture | None:
        """The motion around its largest displacement, in real time, without spaces that are lost in it.

        None where there are too few frames, or the file would be too large.
        """
        frames = self._stretch(motion)
        if len(frames) < FEWEST_FRAMES:
            return None
        full = self._positions("full", motion, frames)
        sequences = [(title(self._run, "full"), full)]
        for space in reduced_runs(self._run, motion):
            moved = self._positions(space, motion, frames)
            if self._near(moved, full):
                sequences.append((title(self._run, space), moved))
        view = look_at_broadside(self._rest, np.concatenate([positions for _, positions in sequences]))
        pause = float(frames[1] - frames[0]) * self._run.scene.time_step
        data = animation(sequences, self._triangles, pause, view, len(frames), ANIMATION_WIDTH)
        if len(data) > ANIMATION_BYTES:
            return None
        begin, end = self._seconds(int(frames[0])), self._seconds(int(frames[-1]))
        caption = f"{self._motion_words(motion)} around its largest pull, {begin:.2f} s to {end:.2f} s in real time."
        return Picture(f"{motion}.webp", caption, data)

    def _positions(self, space: str, motion: str, frames: Indices) -> Array:
        """(N, n, 3), upright."""
        u = displacements(self._run, space, motion)(frames, slice(None))
        positions: Array = self._rest + u @ self._turn.T
        return positions

    def _near(self, positions: Array, full: Array) -> bool:
        """Whether all positions are within a diagonal of the full space's: what is lost must not set the frame."""
        offset = np.linalg.norm(positions - full, axis=-1)
        return bool((offset < self._run.scene.mesh.diagonal).all())

    def _stretch(self, motion: str) -> Indices:
        """Evenly spaced frames around the largest displacement, as many as the surface's size allows."""
        moved = mean_displacement(self._run, motion)
        if moved is None:
            return np.empty(0, dtype=np.int64)
        panels = 1 + len(reduced_runs(self._run, motion))
        most = min(ANIMATION_FRAMES, ANIMATION_TRIANGLES // (panels * len(self._triangles)))
        length = min(round(ANIMATION_SECONDS / self._run.scene.time_step), len(moved))
        stride = max(-(-length // max(most, 1)), 1)
        first = int(np.clip(int(moved.argmax()) - length // 2, 0, len(moved) - length))
        return np.arange(first, first + length, stride, dtype=np.int64)[:most]

    def _seconds(self, frame: int) -> float:
        """The time of a frame: frame i is the state at (i + 1) h."""
        return (frame + 1) * self._run.scene.time_step

    def _motion_words(self, motion: str) -> str:
        return f"Motion {motion} ({ROLE_NAMES[self._run.motions[motion].role]})"


def mean_displacement(run: Run, motion: str) -> Array | None:
    """Mean vertex displacement of the full space in each frame, (N,) metres, where a reduced run recorded it."""
    known = (trajectory.mean_displacement for trajectory in reduced_runs(run, motion).values())
    return next((moved for moved in known if moved is not None and len(moved)), None)


def peaks(values: Array, count: int) -> list[int]:
    """At most `count` indices of the largest values (N,) that are at least N / (2 count) apart, ascending."""
    remaining, chosen = values.astype(np.float64), list[int]()
    apart = max(len(values) // (2 * count), 1) if count else 0
    while len(chosen) < count and np.isfinite(remaining).any():
        peak = int(np.where(np.isfinite(remaining), remaining, -np.inf).argmax())
        chosen.append(peak)
        remaining[max(peak - apart + 1, 0) : peak + apart] = -np.inf
    return sorted(chosen)


def moments(run: Run, count: int) -> list[Moment]:
    """The frames to show: of every test and validation motion, then of the first training motion, if they were run."""
    roles = {name: recorded.role for name, recorded in run.motions.items()}
    shown = [name for name, role in roles.items() if role != "train"] + first_training_motion(run)
    displacements = {name: mean_displacement(run, name) for name in shown}
    return [
        Moment(name, frame)
        for name, moved in displacements.items()
        if moved is not None
        for frame in peaks(moved, count)
    ]


def first_training_motion(run: Run) -> list[str]:
    """The first training motion that a reduced space ran, in a list, or an empty one."""
    names = (name for name, recorded in run.motions.items() if recorded.role == "train" and reduced_runs(run, name))
    return list(names)[:1]


def take_pictures(run: Run, count: int) -> Iterator[Picture | None]:
    """The animation, then a picture of each moment; None for one that cannot be shown.

    Args:
        count: moments of each motion; 0 for no picture and no animation.
    """
    if count == 0:
        return
    studio = Studio(run)
    for motion in first_training_motion(run):
        yield studio.moving(motion)
    for moment in moments(run, count):
        yield studio.still(moment)
