"""The replay inside a report: the motions of a run as a surface, a few modes of it, and their coordinates per frame.

The page decodes x = X + W c. W spans the run's own basis on the surface, widened by the directions that the full-space
frames need most besides, turned to its principal axes and cut off where the rest is not seen. Coordinates and modes are
16-bit integers. How far all this draws from what the run holds is measured and told in the caption.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.trajectory import Trajectory
from ldsim.evaluation.camera import look_at_broadside, upright
from ldsim.evaluation.drawing import DISTANCE_STOPS
from ldsim.evaluation.errors import MM_PER_M
from ldsim.evaluation.finished_run import FinishedRun
from ldsim.evaluation.html import readable
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.surface import coarsened, surface_triangles

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# What the page can bear: vertices drawn, and bytes of modes and of coordinates, which base64 makes a third larger.
MAX_VERTICES = 6000
MODES_BYTES = 1_800_000
COORDINATES_BYTES = 700_000
# Seconds between two frames at most, before motions are left out instead.
LONGEST_PAUSE = 1 / 30
# Directions added to the run's basis, and the root mean square of what is cut off, in diagonals.
EXTRA_MODES = 24
CUT_OFF = 5e-5
INT16 = 32767


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


@dataclass(frozen=True, eq=False)
class Replay:
    """What the page needs, and what its reader must know.

    Attributes:
        data: JSON for evaluation/web/replay.js.
        caption: what is shown and how exactly.
    """

    data: str
    caption: str


def make_replay(run: FinishedRun) -> Replay | None:
    """All motions that a reduced space ran, held-out ones first; None where there is none."""
    stride, names = _shown(run)
    if not names:
        return None
    vertices, triangles = _surface(run.scene.mesh)
    clips = [_clip(run, name, stride, vertices) for name in names]
    modes, coordinates = _compressed(run, clips, vertices)
    scales, modes16, coordinates16 = quantised(modes, coordinates)
    worst, mean = _drawing_error(clips, scales, modes16, coordinates16)
    turn = upright(run.scene.gravity)
    rest = run.scene.mesh.vertices @ turn.T
    view = look_at_broadside(rest, rest)
    data = {
        "up": turn.ravel().tolist(),
        "azimuth": view.azimuth,
        "elevation": view.elevation,
        "stops": DISTANCE_STOPS,
        "rest": packed(run.scene.mesh.vertices[vertices], "f4"),
        "triangles": packed(triangles, "u2"),
        "modes": packed(modes16.T, "i2"),
        "scales": scales.tolist(),
        "motions": [_described(run, clip, stride, found) for clip, found in zip(clips, coordinates16, strict=True)],
    }
    caption = _caption(run, stride, names, len(vertices), len(scales), worst, mean)
    return Replay(json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"), caption)


def quantised(
    modes: Array, coordinates: Sequence[Sequence[Array]]
) -> tuple[Array, NDArray[np.int16], list[list[NDArray[np.int16]]]]:
    """Modes (3v, K) and rows of coordinates (·, K) as int16, and the scale of each product, (K,)."""
    rows = np.concatenate([film for clip in coordinates for film in clip])
    mode_scale = np.maximum(np.abs(modes).max(axis=0), 1e-300) / INT16
    scale = np.maximum(np.abs(rows).max(axis=0, initial=0), 1e-300) / INT16
    small = [[np.rint(film / scale).astype(np.int16) for film in clip] for clip in coordinates]
    return mode_scale * scale, np.rint(modes / mode_scale).astype(np.int16), small


def packed(values: NDArray[np.generic], kind: str) -> list[str]:
    """An array as the page unpacks it: its type, one of f4, u2 and i2, and its bytes, little-endian, in base64."""
    return [kind, b64encode(np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()).decode("ascii")]


def _shown(run: FinishedRun) -> tuple[int, list[str]]:
    """Every how-manyth frame, and of which motions, so that the coordinates fit."""
    names = [name for name in run.recorded if run.reduced_runs(name)]
    names.sort(key=lambda name: run.recorded[name].role != "heldout")
    row = 2 * (run.basis.basis.k + EXTRA_MODES) * 3
    room = max(COORDINATES_BYTES // row, 1)
    longest = max(int(LONGEST_PAUSE / run.scene.time_step), 1)

    def frames() -> int:
        return sum(run.snapshots.frames(name) for name in names)

    while len(names) > 1 and frames() > room * longest:
        names.pop()
    return max(-(-frames() // room), 1), names


def _surface(mesh: Mesh) -> tuple[Indices, Indices]:
    """The mesh's vertices that are drawn, (v,), and triangles in their numbering, (t, 3)."""
    triangles = coarsened(mesh.vertices, surface_triangles(mesh), MAX_VERTICES)
    vertices, numbers = np.unique(triangles, return_inverse=True)
    return vertices.astype(np.int64), numbers.reshape(triangles.shape).astype(np.int64)


def _clip(run: FinishedRun, motion: str, stride: int, vertices: Indices) -> Clip:
    recorded, reduced = run.recorded[motion], run.reduced_runs(motion)
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
    run: FinishedRun, motion: str, frames: Indices, vertices: Indices, pulled: Sequence[tuple[Indices, Indices]]
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
    run: FinishedRun,
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
    whole = np.isfinite(q).all(axis=1)
    if trajectory.max_error is not None:
        whole &= np.nan_to_num(trajectory.max_error, nan=np.inf) < run.scene.mesh.diagonal
    kept = frames[: int(np.searchsorted(frames, len(whole) if whole.all() else whole.argmin()))]
    U = np.hstack([run.basis.basis.U[:, : q.shape[1]], run.lifting.fields])
    q = np.hstack([q, run.lifting.coordinates(run.recorded[motion].motion)])
    U = U.reshape(-1, 3, q.shape[1])
    rows = U[vertices].reshape(-1, q.shape[1])
    grips = []
    for during, held in pulled:
        mean = U[held].mean(axis=0)
        grips.append(run.scene.mesh.vertices[held].mean(axis=0) + q[frames[during[during < len(kept)]]] @ mean.T)
    errors = (None if error is None else error[kept] for error in (trajectory.mean_error, trajectory.max_error))
    return Film(space, (q[kept] @ rows.T).astype(np.float32), *errors, grips)


def _compressed(run: FinishedRun, clips: Sequence[Clip], vertices: Indices) -> tuple[Array, list[list[Array]]]:
    """Modes (3v, K) that hold all films, and the coordinates of each film, (N, K).

    What the run's basis, with the fields of pins that move, misses of a film is searched by a randomised range finder
    with one power iteration (Halko, Martinsson and Tropp 2011, Algorithm 4.4).
    """
    U = np.hstack([run.basis.basis.U, run.lifting.fields])
    U = U.reshape(run.scene.mesh.n_vertices, 3, -1)[vertices].reshape(3 * len(vertices), -1)
    Q = np.linalg.qr(U)[0]
    films = [film.displacements.astype(np.float64) for clip in clips for film in clip.films]
    missed = [film - film @ Q @ Q.T for film in films]
    rng = np.random.default_rng(0)
    extra = min(EXTRA_MODES, sum(map(len, missed)), len(U) - Q.shape[1])
    sketch = sum((left.T @ rng.normal(size=(len(left), extra)) for left in missed), np.zeros((len(U), extra)))
    sketch = sum((left.T @ (left @ sketch) for left in missed), np.zeros((len(U), extra)))
    wide = np.linalg.qr(np.hstack([Q, sketch / max(float(np.abs(sketch).max(initial=0)), 1e-300)]))[0]
    rows = np.concatenate([film @ wide for film in films])
    _, sizes, axes = np.linalg.svd(rows, full_matrices=False)
    allowed = (CUT_OFF * run.scene.mesh.diagonal) ** 2 * len(rows) * len(vertices)
    tail = np.cumsum(sizes[::-1] ** 2)[::-1]
    count = max(min(int((tail > allowed).sum()), MODES_BYTES // (2 * len(U))), 1)
    modes = wide @ axes[:count].T
    ends = np.cumsum([len(film) for film in films])[:-1]
    found = iter(np.split(rows @ axes[:count].T, ends))
    return modes, [[next(found) for _ in clip.films] for clip in clips]


def _drawing_error(
    clips: Sequence[Clip],
    scales: Array,
    modes: NDArray[np.int16],
    coordinates: Sequence[Sequence[NDArray[np.int16]]],
) -> tuple[float, float]:
    """Largest and mean distance between drawn vertices as the page decodes them and as the run has them, metres."""
    W = modes * scales
    worst, total, count = 0.0, 0.0, 0
    for clip, found in zip(clips, coordinates, strict=True):
        for film, c in zip(clip.films, found, strict=True):
            off = np.linalg.norm((c @ W.T - film.displacements).reshape(len(c), -1, 3), axis=2)
            worst, total, count = max(worst, float(off.max(initial=0))), total + float(off.sum()), count + off.size
    return worst, total / max(count, 1)


def _described(
    run: FinishedRun, clip: Clip, stride: int, coordinates: Sequence[NDArray[np.int16]]
) -> Mapping[str, object]:
    """A clip as the page reads it."""
    far = [film.max_error for film in clip.films if film.max_error is not None and len(film.max_error)]
    limit = float(np.percentile(np.concatenate(far), 98)) if far else 0.0
    first = clip.films[0].displacements
    return {
        "name": clip.motion,
        "role": clip.role,
        "frames": len(clip.frames),
        "seconds": stride * run.scene.time_step,
        "limit": limit,
        "start": int(np.einsum("ij,ij->i", first, first).argmax()) if len(first) else 0,
        "films": [
            {
                "space": film.space,
                "title": run.title(film.space),
                "frames": len(c),
                "coordinates": packed(c, "i2"),
                "mean_mm": None if film.mean_error is None else packed(MM_PER_M * film.mean_error, "f4"),
                "grips": [packed(grip, "f4") for grip in film.grips],
            }
            for film, c in zip(clip.films, coordinates, strict=True)
        ],
        "drags": [{"first": first, "targets": packed(targets, "f4")} for first, targets in clip.drags],
    }


def _caption(
    run: FinishedRun, stride: int, names: Sequence[str], vertices: int, modes: int, worst: float, mean: float
) -> str:
    """What is shown and how exactly."""
    every = "Every frame" if stride == 1 else f"One frame in {stride}"
    left_out = sum(bool(run.reduced_runs(name)) for name in run.recorded) - len(names)
    told = f" ({left_out} more are left out for size)" if left_out else ""
    whole = len(np.unique(surface_triangles(run.scene.mesh)))
    surface = f"all {readable(whole)}" if vertices == whole else f"{readable(vertices)} of {readable(whole)}"
    return (
        f"{every} of {len(names)} motion{'s' * (len(names) > 1)}{told}, by {surface} vertices of the surface and {modes} "
        f"modes: drawn to {readable(MM_PER_M * mean)} mm of the run's frames on average, {readable(MM_PER_M * worst)} mm "
        "at most. The numbers in the panels are of the whole mesh, as the run has them."
    )
