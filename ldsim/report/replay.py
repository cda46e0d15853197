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

from ldsim.mesh.mesh import Mesh
from ldsim.mesh.surface import coarsened, surface_triangles
from ldsim.report.camera import first_look, upright
from ldsim.report.replay_films import Clip, take_clip
from ldsim.report.runs import reduced_runs, title
from ldsim.report.schema import MM_PER_M
from ldsim.report.wording import readable
from ldsim.run import Run
from ldsim.web import inlined

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
class Replay:
    """What the page needs, and what its reader must know.

    Attributes:
        data: JSON for web/src/replay.js.
        caption: what is shown and how exactly.
    """

    data: str
    caption: str


def make_replay(run: Run) -> Replay | None:
    """All motions that a reduced space ran, held-out ones first; None where there is none."""
    stride, names = _shown(run)
    if not names:
        return None
    vertices, triangles = _surface(run.scene.mesh)
    clips = [take_clip(run, name, stride, vertices) for name in names]
    modes, coordinates = _compressed(run, clips, vertices)
    scales, modes16, coordinates16 = quantised(modes, coordinates)
    worst, mean = _drawing_error(clips, scales, modes16, coordinates16)
    low, high = _box(run, clips, vertices, upright(run.scene.gravity))
    data = first_look(run.scene) | {
        "low": low.tolist(),
        "high": high.tolist(),
        "rest": packed(run.scene.mesh.vertices[vertices], "f4"),
        "triangles": packed(triangles, "u2"),
        "modes": packed(modes16.T, "i2"),
        "scales": scales.tolist(),
        "motions": [_described(run, clip, stride, found) for clip, found in zip(clips, coordinates16, strict=True)],
    }
    caption = _caption(run, stride, names, len(vertices), len(scales), worst, mean)
    return Replay(inlined(data), caption)


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


def _shown(run: Run) -> tuple[int, list[str]]:
    """Every how-manyth frame, and of which motions, so that the coordinates fit."""
    names = [name for name in run.motions if reduced_runs(run, name)]
    names.sort(key=lambda name: run.motions[name].role != "heldout")
    row = 2 * (run.basis.k + EXTRA_MODES) * 3
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


def _compressed(run: Run, clips: Sequence[Clip], vertices: Indices) -> tuple[Array, list[list[Array]]]:
    """Modes (3v, K) that hold all films, and the coordinates of each film, (N, K).

    What the run's basis, with the fields of pins that move, misses of full space (the reduced films lie in it) is
    searched by a randomised range finder with one power iteration (Halko, Martinsson and Tropp 2011, Algorithm 4.4).
    """
    U = np.hstack([run.basis.matrix, run.lifting.fields])
    U = U.reshape(run.scene.mesh.n_vertices, 3, -1)[vertices].reshape(3 * len(vertices), -1)
    Q = np.linalg.qr(U)[0].astype(np.float32)
    films = [film for clip in clips for film in clip.films]
    missed = [film.displacements - (film.displacements @ Q) @ Q.T for film in films if film.space == "full"]
    extra = min(EXTRA_MODES, sum(map(len, missed)), len(U) - Q.shape[1])
    sketch, rng = np.zeros((len(U), extra)), np.random.default_rng(0)
    for left in missed:
        sketch += left.T @ rng.normal(size=(len(left), extra)).astype(np.float32)
    sketch = sum((left.T @ (left @ sketch.astype(np.float32)) for left in missed), np.zeros_like(sketch))
    wide = np.linalg.qr(np.hstack([Q, sketch / max(float(np.abs(sketch).max(initial=0)), 1e-300)]))[0]
    rows = np.concatenate([film.displacements @ wide.astype(np.float32) for film in films]).astype(np.float64)
    _, sizes, axes = np.linalg.svd(rows, full_matrices=False)
    allowed = (CUT_OFF * run.scene.mesh.diagonal) ** 2 * len(rows) * len(vertices)
    tail = np.cumsum(sizes[::-1] ** 2)[::-1]
    count = max(min(int((tail > allowed).sum()), MODES_BYTES // (2 * len(U))), 1)
    modes = wide @ axes[:count].T
    ends = np.cumsum([len(film.displacements) for film in films])[:-1]
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
            off = np.linalg.norm((c @ W.T - film.displacements).reshape(len(c), len(W) // 3, 3), axis=2)
            worst, total, count = max(worst, float(off.max(initial=0))), total + float(off.sum()), count + off.size
    return worst, total / max(count, 1)


def _box(run: Run, clips: Sequence[Clip], vertices: Indices, turn: Array) -> tuple[Array, Array]:
    """The corners (3,), metres, of the upright box that all films stay in."""
    rest = run.scene.mesh.vertices[vertices]
    ends = []
    for film in (film for clip in clips for film in clip.films if len(film.displacements)):
        at = (rest + film.displacements.reshape(-1, *rest.shape)) @ turn.T
        ends.append((at.min(axis=(0, 1)), at.max(axis=(0, 1))))
    lows, highs = zip(*ends, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _described(run: Run, clip: Clip, stride: int, coordinates: Sequence[NDArray[np.int16]]) -> Mapping[str, object]:
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
                "title": title(run, film.space),
                "frames": len(c),
                "coordinates": packed(c, "i2"),
                "mean_mm": None if film.mean_error is None else packed(MM_PER_M * film.mean_error, "f4"),
                "grips": [packed(grip, "f4") for grip in film.grips],
            }
            for film, c in zip(clip.films, coordinates, strict=True)
        ],
        "drags": [{"first": first, "targets": packed(targets, "f4")} for first, targets in clip.drags],
    }


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
