"""What the replay shows of a run: each motion in each space, on the vertices that are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.report.runs import displacements, reduced_runs
from ldsim.run import Run


@dataclass(frozen=True, eq=False)
class SpaceReplay:
    """One motion in one space.

    Attributes:
        space: "full", "linear" or "latent".
        displacements: of the drawn vertices, (N, 3v) float32, metres; ends where the run was lost.
        mean_error, max_error: vertex distances to full space in each of these frames, over the whole mesh, (N,)
            metres; None in full space, and where it is not known.
        grips: of each drag, the centroid of what it holds in the frames in which it pulls, (·, 3) metres.
    """

    space: str
    displacements: NDArray[np.float32]
    mean_error: Array | None
    max_error: Array | None
    grips: Sequence[Array]


@dataclass(frozen=True, eq=False)
class MotionReplay:
    """One motion in all spaces.

    Attributes:
        frames: those shown, (N,), evenly spaced.
        spaces: full space first, unless there is none to compare with.
        drags: index among `frames` of the first in which each pulls, and the targets from there on, (·, 3) metres.
    """

    motion: str
    role: str
    frames: Indices
    spaces: Sequence[SpaceReplay]
    drags: Sequence[tuple[int, Array]]


def replay_motion(run: Run, motion: str, stride: int, vertices: Indices) -> MotionReplay:
    """Every `stride`-th frame of a motion in every space, on the given vertices (v,)."""
    recorded, reduced, total = run.motions[motion], reduced_runs(run, motion), run.played.frames(motion)
    frames = np.arange(min(stride, total) - 1, total, stride)
    drags, pulled = [], []
    for i, drag in enumerate(recorded.motion.drags):
        during = np.flatnonzero((frames >= drag.start) & (frames < drag.stop))
        if len(during) and i in recorded.held:
            drags.append((int(during[0]), drag.targets[frames[during] - drag.start]))
            pulled.append((during, recorded.held[i]))
    judged = all(trajectory.mean_error is not None for trajectory in reduced.values())
    shown = [*(["full"] if judged else []), *reduced]
    spaces = [_replay_space(run, motion, space, frames, vertices, pulled) for space in shown]
    return MotionReplay(motion, recorded.role, frames, spaces, drags)


def _replay_space(
    run: Run, motion: str, space: str, frames: Indices, vertices: Indices, pulled: Sequence[tuple[Indices, Indices]]
) -> SpaceReplay:
    """Until the run diverged. A vertex that is far off for a while is shown: it belongs to what the space is worth."""
    u, trajectory = displacements(run, space, motion), reduced_runs(run, motion).get(space)
    mean_error = max_error = None
    if trajectory is not None and trajectory.coordinates is not None:
        whole = np.asarray(np.isfinite(trajectory.coordinates).all(axis=1))
        frames = frames[: int(np.searchsorted(frames, len(whole) if whole.all() else whole.argmin()))]
        mean_error, max_error = (
            None if error is None else error[frames] for error in (trajectory.mean_error, trajectory.max_error)
        )
    rest = run.scene.mesh.vertices
    grips = [
        rest[held].mean(axis=0) + u(frames[during[during < len(frames)]], held).mean(axis=1) for during, held in pulled
    ]
    moved = u(frames, vertices).reshape(len(frames), 3 * len(vertices)).astype(np.float32)
    return SpaceReplay(space, moved, mean_error, max_error, grips)
