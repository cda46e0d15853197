"""What the replay shows of a run: each motion in each space, on the vertices that are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.trajectory import Trajectory
from ldsim.report.runs import reduced_runs
from ldsim.run import Run

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Film:
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
class Clip:
    """One motion in all spaces.

    Attributes:
        frames: those shown, (N,), evenly spaced.
        films: full space first, unless there is none to compare with.
        drags: index among `frames` of the first in which each pulls, and the targets from there on, (·, 3) metres.
    """

    motion: str
    role: str
    frames: Indices
    films: Sequence[Film]
    drags: Sequence[tuple[int, Array]]


def take_clip(run: Run, motion: str, stride: int, vertices: Indices) -> Clip:
    """Every `stride`-th frame of a motion in every space, on the given vertices (v,)."""
    recorded, reduced = run.motions[motion], reduced_runs(run, motion)
    frames = np.arange(stride - 1, run.snapshots.frames(motion), stride)
    if len(frames) == 0:
        frames = np.array([run.snapshots.frames(motion) - 1])
    drags, pulled = [], []
    for i, drag in enumerate(recorded.motion.drags):
        during = np.flatnonzero((frames >= drag.start) & (frames < drag.stop))
        if len(during) and i in recorded.held:
            drags.append((int(during[0]), drag.targets[frames[during] - drag.start]))
            pulled.append((during, recorded.held[i]))
    films = []
    if all(trajectory.mean_error is not None for trajectory in reduced.values()):
        films.append(_full_film(run, motion, frames, vertices, pulled))
    for space, trajectory in reduced.items():
        films.append(_reduced_film(run, motion, space, trajectory, frames, vertices, pulled))
    return Clip(motion, recorded.role, frames, films, drags)


def _full_film(
    run: Run, motion: str, frames: Indices, vertices: Indices, pulled: Sequence[tuple[Indices, Indices]]
) -> Film:
    """The recorded frames; one is read at a time."""
    read = run.snapshots.reader(motion)
    displacements = np.empty((len(frames), 3 * len(vertices)), dtype=np.float32)
    rest = run.scene.mesh.vertices
    grips = [np.empty((len(during), 3)) for during, _ in pulled]
    for row, frame in enumerate(frames):
        u = read(int(frame), int(frame) + 1)[0]
        displacements[row] = u[vertices].ravel()
        for grip, (during, held) in zip(grips, pulled, strict=True):
            if during[0] <= row <= during[-1]:
                grip[row - during[0]] = (rest[held] + u[held]).mean(axis=0)
    return Film("full", displacements, None, None, grips)


def _reduced_film(
    run: Run,
    motion: str,
    space: str,
    trajectory: Trajectory,
    frames: Indices,
    vertices: Indices,
    pulled: Sequence[tuple[Indices, Indices]],
) -> Film:
    """u = U q + L a until the run is lost: not a number, or a vertex farther than the diagonal from full space."""
    q = trajectory.coordinates
    assert q is not None, "reduced runs keep their coordinates"
    whole = np.asarray(np.isfinite(q).all(axis=1))
    if trajectory.max_error is not None:
        whole &= np.nan_to_num(trajectory.max_error, nan=np.inf) < run.scene.mesh.diagonal
    kept = frames[: int(np.searchsorted(frames, len(whole) if whole.all() else whole.argmin()))]
    U = np.hstack([run.basis.matrix[:, : q.shape[1]], run.lifting.fields])
    q = np.hstack([q, run.lifting.coordinates(run.motions[motion].motion)])
    U = U.reshape(-1, 3, q.shape[1])
    rows = U[vertices].reshape(-1, q.shape[1])
    grips = []
    for during, held in pulled:
        mean = U[held].mean(axis=0)
        grips.append(run.scene.mesh.vertices[held].mean(axis=0) + q[frames[during[during < len(kept)]]] @ mean.T)
    mean_error, max_error = (
        None if error is None else error[kept] for error in (trajectory.mean_error, trajectory.max_error)
    )
    return Film(space, (q[kept] @ rows.T).astype(np.float32), mean_error, max_error, grips)
