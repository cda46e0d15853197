"""Which coordinates a condensed space needs: few, for what they do not show is in equilibrium with them.

They are the leading columns of the basis, which hold the largest motions, or the slowest of its combinations: then what
is left to equilibrium is fast, and stiff where the solid is pulled, so that dents are small. Where a solid bends far
the former may be better, for what is slow at rest does not tell apart poses that are bent far.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.reduced.matrices import reduced_rest_stiffness
from ldsim.errors import SolverError
from ldsim.jit import in_threads
from ldsim.mechanics.loads import Loads, MotionLoads
from ldsim.pipeline.progress import Progress
from ldsim.run import Run
from ldsim.space.basis import Basis
from ldsim.space.compliance import Compliance

# Dimensions that are tried; what is enough of the worst frame, its mean error over its mean displacement; and frames
# that are looked at. Where a solid is next to buckling, a run is ten times as far off as the relaxed poses are: a ring
# 12 % where its poses were 1.8 % off (r 4), 8 % where they were 0.4 % (r 8), and 3 % where they were 0.2 % (r 12).
SIZES, ENOUGH, FRAMES = (4, 6, 8, 10, 12, 16), 0.0025, 24
# Relaxed training poses for each entry of S, r (r + 1) / 2: with fewer, what V_eff misses on motions beyond those that
# it learned from is more than what further coordinates show. X's x_2 is 4.1 % off at r 16 with 400, and 2.0 % at r 12.
POSES_OF_AN_ENTRY = 4


def needed_coordinates(run: Run, r: int | None, poses: int, progress: Progress) -> Array:
    """Coordinates in which the frames of the training motions are relaxed poses, as combinations of the basis' columns.

    Every further coordinate makes V_eff a function of one more variable, which takes many more poses to know; so there
    are not as many as one can afford, but the fewest that are enough for the worst frame, and no more than the poses
    can tell. By bisection: more coordinates hold more. Of the two orders that one is taken whose relaxed poses are
    nearer to the frames in the mean.

    Args:
        r: how many; None finds the fewest that are enough.
        poses: how many training poses will be relaxed.

    Returns:
        (k, r), with orthonormal columns.
    """
    orders = {"largest": np.eye(run.basis.k), "slowest": slowest(run)}
    frames, tried = list(frames_of(run)), dict[int, dict[str, Array]]()
    with progress.bar("train: which coordinates", None, " tried") as bar:

        def enough(size: int) -> bool:
            tried[size] = {}
            for name, order in orders.items():
                off = slaving_errors(Compliance(run.scene, combined(run.basis, order[:, :size])), frames)
                tried[size][name] = off
                bar.say(
                    f"the {size} {name} miss a pull by {100 * _mean(off):.2g} %, the worst by {100 * _worst(off):.2g} %"
                )
                bar.update()
            return min(map(_worst, tried[size].values())) <= ENOUGH

        if r is None:
            told = [size for size in SIZES if POSES_OF_AN_ENTRY * size * (size + 1) // 2 <= poses] or [SIZES[0]]
            sizes = [size for size in told if size < run.basis.k] or [run.basis.k]
            r = sizes[bisect_left(sizes[:-1], True, key=enough)]
        if r not in tried:
            enough(r)
    best = min(orders, key=lambda name: _mean(tried[r][name]))
    return np.ascontiguousarray(orders[best][:, :r])


def slowest(run: Run) -> Array:
    """The vibration modes in the span of the basis at rest, by ascending frequency, (k, k): eigenvectors of UᵀK₀U."""
    vectors: Array = np.linalg.eigh(reduced_rest_stiffness(run.scene, run.basis))[1]
    return vectors


def combined(basis: Basis, combinations: Array) -> Basis:
    """The basis of combinations (k, r) of the columns of another; orthonormal where both are."""
    return Basis.of(np.ascontiguousarray(basis.matrix @ combinations), basis.metric)


def _worst(off: Array) -> float:
    """Of the frames that have an equilibrium; where none has, infinite."""
    known = off[~np.isnan(off)]
    return float(known.max()) if len(known) else math.inf


def _mean(off: Array) -> float:
    """Where one that has no equilibrium is all of its motion off."""
    return float(np.nan_to_num(off, nan=1.0).mean())


def slaving_errors(compliance: Compliance, frames: Iterable[tuple[Array, Loads]]) -> Array:
    """How far frames are from the relaxed poses of their coordinates.

    Loads act on what is slaved as they do when the space is stepped, by the residual compliance. What remains is what r
    coordinates lose, however well V_eff is known: fast motion, and compliance that changes as the solid bends.

    Args:
        frames: displacements of the full space, (n, 3) metres, with what acts.

    Returns:
        (f,): the mean distance, a share of the mean displacement of that frame, or of all frames where that is larger;
        NaN where coordinates have no stable equilibrium.
    """
    _ = compliance.relaxation  # once, before there are threads
    found = in_threads(lambda frame: _off(compliance, *frame), frames)
    off, moved = np.array(list(found)).reshape(-1, 2).T
    shares: Array = off / np.maximum(moved, moved.mean()) if moved.any() else np.full(len(off), math.inf)
    return shares


def _off(compliance: Compliance, u: Array, loads: Loads) -> tuple[float, float]:
    """Mean distance, NaN where it has no equilibrium, and mean displacement, metres, of one frame."""
    moved = float(np.linalg.norm(u, axis=1).mean())
    try:
        relaxed = compliance.relaxation.from_pose(u).u
    except SolverError:
        return math.nan, moved
    found = relaxed + compliance.sag(loads.gravity)
    for grab in loads.grabs:
        centre = (compliance.scene.mesh.vertices + u)[grab.vertices].mean(axis=0)
        found += compliance.moved(grab.vertices, relaxed, grab.stiffness * (grab.target - centre))
    return float(np.linalg.norm(found - u, axis=1).mean()), moved


def frames_of(run: Run, role: str = "train") -> Iterator[tuple[Array, Loads]]:
    """Frames of the motions of a role, (n, 3) metres, with what acts: where pulls end, or spread where they are few."""
    names = run.snapshots.with_role(role)
    of_each = -(-FRAMES // len(names))
    for name in names:
        recorded, read = run.snapshots.recorded(name), run.snapshots.reader(name)
        loads = MotionLoads(recorded.motion, run.scene, dict(recorded.held))
        count = run.snapshots.frames(name)
        ends = [min(drag.stop, count) - 1 for drag in recorded.motion.drags if drag.start < count]
        frames = np.array(
            ends if len(ends) >= of_each // 2 else np.linspace(0, count - 1, of_each + 2)[1:-1], dtype=int
        )
        some = np.linspace(0, len(frames) - 1, min(of_each, len(frames))).astype(int)
        for frame in np.unique(frames[some]).tolist():
            yield np.asarray(read(frame, frame + 1)[0], dtype=np.float64), loads.at(frame, None)
