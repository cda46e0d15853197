"""The replay inside a report: the motions of a run as a surface, a few modes of it, and their coordinates per frame.

The page decodes x = X + W c. W spans the run's own basis on the surface, widened by the directions that the full-space
frames need most besides, turned to its principal axes and cut off where the rest is not seen. Coordinates and modes are
16-bit integers. How far all this draws from what the run holds is measured and told in the caption.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.mesh.surface import Surface, surface_triangles
from ldsim.report.camera import first_look, upright
from ldsim.report.runs import displacements, reduced_runs, runs, tests_first, title
from ldsim.report.schema import MM_PER_M
from ldsim.report.wording import readable
from ldsim.run import Run
from ldsim.web import inlined

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


@dataclass(frozen=True, eq=False)
class Replay:
    """What the page needs, and what its reader must know.

    Attributes:
        data: JSON for web/src/replay.js.
        caption: what is shown and how exactly.
    """

    data: str
    caption: str


def make_replay(run: Run) -> Replay | None:
    """All motions that a reduced space ran, test ones first, then validation; None where there is none."""
    stride, names = _shown(run)
    if not names:
        return None
    surface = Surface.of(run.scene.mesh, MAX_VERTICES)
    vertices = surface.vertices
    motions = [replay_motion(run, name, stride, vertices) for name in names]
    every = [shown for motion in motions for shown in motion.spaces]
    if not any(len(shown.displacements) for shown in every):  # lost in the first frame, and nothing beside it
        return None
    modes, coordinates = _compressed(run, every, vertices)
    scales, modes16, coordinates16 = quantised(modes, coordinates)
    worst, mean = _drawing_error(every, modes16 * scales, coordinates16)
    low, high = _box(run, every, vertices)
    left = iter(coordinates16)
    data = first_look(run.scene) | {
        "low": low.tolist(),
        "high": high.tolist(),
        "rest": packed(surface.rest, "f4"),
        "triangles": packed(surface.triangles, "u2"),
        "modes": packed(modes16, "i2"),
        "scales": scales.tolist(),
        "motions": [_described(run, motion, stride, [next(left) for _ in motion.spaces]) for motion in motions],
    }
    caption = _caption(run, stride, names, len(vertices), len(scales), worst, mean)
    return Replay(inlined(data), caption)


def quantised(modes: Array, coordinates: Sequence[Array]) -> tuple[Array, NDArray[np.int16], list[NDArray[np.int16]]]:
    """Modes (3v, K) and coordinates (·, K) as int16, and the scale of each product, (K,)."""
    mode_scale = np.maximum(np.abs(modes).max(axis=0), 1e-300) / INT16
    scale = np.maximum(np.abs(np.concatenate(coordinates)).max(axis=0, initial=0), 1e-300) / INT16
    small = [np.rint(rows / scale).astype(np.int16) for rows in coordinates]
    return mode_scale * scale, np.rint(modes / mode_scale).astype(np.int16), small


def packed(values: NDArray[np.generic], kind: str) -> list[str]:
    """An array as the page unpacks it: its type, one of f4, u2 and i2, and its bytes, little-endian, in base64."""
    return [kind, b64encode(np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()).decode("ascii")]


def _shown(run: Run) -> tuple[int, list[str]]:
    """Every how-manyth frame, and of which motions, so that the coordinates fit."""
    names = [name for name in tests_first(run) if reduced_runs(run, name)]
    row = 2 * (run.basis.k + EXTRA_MODES) * 3
    room = max(COORDINATES_BYTES // row, 1)
    longest = max(int(LONGEST_PAUSE / run.scene.time_step), 1)

    def frames() -> int:
        return sum(run.played.frames(name) for name in names)

    while len(names) > 1 and frames() > room * longest:
        names.pop()
    return max(-(-frames() // room), 1), names


def _compressed(run: Run, every: Sequence[SpaceReplay], vertices: Indices) -> tuple[Array, list[Array]]:
    """Modes (3v, K) that hold every motion in every space, and the coordinates of each, (N, K).

    What the run's basis, with the fields of pins that move, misses of full space and of a condensed one is searched by
    a randomised range finder with one power iteration (Halko, Martinsson and Tropp 2011, Algorithm 4.4).
    """
    U = np.hstack([run.basis.matrix, run.lifting.fields])
    U = U.reshape(run.scene.mesh.n_vertices, 3, -1)[vertices].reshape(3 * len(vertices), -1)
    Q = np.linalg.qr(U)[0].astype(np.float32)
    outside = ("full", "latent") if run.model.condensed else ("full",)
    missed = [shown.displacements - (shown.displacements @ Q) @ Q.T for shown in every if shown.space in outside]
    extra = min(EXTRA_MODES, sum(map(len, missed)), len(U) - Q.shape[1])
    sketch, rng = np.zeros((len(U), extra)), np.random.default_rng(0)
    for left in missed:
        sketch += left.T @ rng.normal(size=(len(left), extra)).astype(np.float32)
    sketch = sum((left.T @ (left @ sketch.astype(np.float32)) for left in missed), np.zeros_like(sketch))
    wide = np.linalg.qr(np.hstack([Q, sketch / max(float(np.abs(sketch).max(initial=0)), 1e-300)]))[0]
    rows = np.concatenate([shown.displacements @ wide.astype(np.float32) for shown in every]).astype(np.float64)
    _, sizes, axes = np.linalg.svd(rows, full_matrices=False)
    allowed = (CUT_OFF * run.scene.mesh.diagonal) ** 2 * len(rows) * len(vertices)
    tail = np.cumsum(sizes[::-1] ** 2)[::-1]
    count = max(min(int((tail > allowed).sum()), MODES_BYTES // (2 * len(U))), 1)
    modes = wide @ axes[:count].T
    ends = np.cumsum([len(shown.displacements) for shown in every])[:-1]
    return modes, np.split(rows @ axes[:count].T, ends)


def _drawing_error(
    every: Sequence[SpaceReplay], W: Array, coordinates: Sequence[NDArray[np.int16]]
) -> tuple[float, float]:
    """Largest and mean distance between drawn vertices as the page decodes them, W c, and in the run, metres."""
    worst, total, count = 0.0, 0.0, 0
    for shown, c in zip(every, coordinates, strict=True):
        off = np.linalg.norm((c @ W.T - shown.displacements).reshape(len(c), len(W) // 3, 3), axis=2)
        worst, total, count = max(worst, float(off.max(initial=0))), total + float(off.sum()), count + off.size
    return worst, total / max(count, 1)


def _box(run: Run, every: Sequence[SpaceReplay], vertices: Indices) -> tuple[Array, Array]:
    """The corners (3,), metres, of the upright box that all motions stay in, but for frames that are far off."""
    rest, turn, far = run.scene.mesh.vertices[vertices], upright(run.scene.gravity), run.scene.mesh.diagonal
    near = [one.displacements if one.max_error is None else one.displacements[one.max_error < far] for one in every]
    places = [(rest + u.reshape(-1, *rest.shape)) @ turn.T for u in near if len(u)]
    low = np.min([at.min(axis=(0, 1)) for at in places], axis=0)
    return low, np.max([at.max(axis=(0, 1)) for at in places], axis=0)


def _described(
    run: Run, motion: MotionReplay, stride: int, coordinates: Sequence[NDArray[np.int16]]
) -> Mapping[str, object]:
    """A motion as the page reads it."""
    far = [shown.max_error for shown in motion.spaces if shown.max_error is not None and len(shown.max_error)]
    limit = float(np.percentile(np.concatenate(far), 98)) if far else 0.0
    first = motion.spaces[0].displacements
    return {
        "name": motion.motion,
        "role": motion.role,
        "frames": len(motion.frames),
        "seconds": stride * run.scene.time_step,
        "limit": limit,
        "start": int(np.einsum("ij,ij->i", first, first).argmax()) if len(first) else 0,
        "spaces": [
            {
                "space": shown.space,
                "title": title(run, shown.space) + _step_words(run, shown.space, motion.motion),
                "frames": len(c),
                "coordinates": packed(c, "i2"),
                "mean_mm": None if shown.mean_error is None else packed(MM_PER_M * shown.mean_error, "f4"),
                "grips": [packed(grip, "f4") for grip in shown.grips],
            }
            for shown, c in zip(motion.spaces, coordinates, strict=True)
        ],
        "drags": [{"first": first, "targets": packed(targets, "f4")} for first, targets in motion.drags],
    }


def _step_words(run: Run, space: str, motion: str) -> str:
    """How long a step took, where it was timed."""
    timed = runs(run, space).get(motion)
    return "" if timed is None else f", {readable(1000 * float(np.nanmedian(timed.seconds)))} ms"


def _caption(run: Run, stride: int, names: Sequence[str], vertices: int, modes: int, worst: float, mean: float) -> str:
    """What is shown and how exactly."""
    every = "every frame" if stride == 1 else f"one frame in {stride}"
    left_out = sum(bool(reduced_runs(run, name)) for name in run.motions) - len(names)
    told = f" ({left_out} more left out for size)" if left_out else ""
    whole = len(np.unique(surface_triangles(run.scene.mesh)))
    surface = f"all {readable(whole)}" if vertices == whole else f"{readable(vertices)} of {readable(whole)}"
    motions = f"{len(names)} motion{'s' * (len(names) > 1)}{told}"
    return (
        f"{motions}, {every}; {surface} vertices of the surface, {modes} modes. "
        f"Drawn to {readable(MM_PER_M * mean)} mm of the run’s frames on average, {readable(MM_PER_M * worst)} mm at "
        "most; the numbers in the panels are the run’s own, of the whole mesh."
    )
