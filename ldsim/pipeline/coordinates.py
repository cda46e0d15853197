"""Which coordinates a condensed space needs: few, for what they do not show is in equilibrium with them.

They are the leading columns of the basis, which hold the largest motions, or the slowest of its combinations: then what
is left to equilibrium is fast, and stiff where the solid is pulled, so that dents are small. Where a solid bends far
the leading columns may be better, for what is slow at rest does not tell apart poses that are bent far. But they mix
stiff motions with slow ones, so that S changes much as the solid bends, and then V_eff is hard to learn.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

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
# Tried one after another where none of these is enough, as long as a run is expected to be at most this share as far
# off as with fewer: more take longer to relax and to step (docs/notebook/2026-11-30-more_coordinates.md).
LARGER, WORTH = (20, 24), 0.75
# What V_eff of so many coordinates misses, as a share of a motion, for the square of how much S changes in its frames.
# It grows with the cube of their number, for S has r²/2 entries, each a function of r variables. Set by runs of two
# solids, with 400 relaxed training poses (docs/notebook/2026-11-26-coordinates.md).
OF_CHANGE, COORDINATES = 1e-4, 12


def needed_coordinates(run: Run, r: int | None, progress: Progress) -> Array:
    """Coordinates in which the frames of the training motions are relaxed poses, as combinations of the basis' columns.

    Every further coordinate makes V_eff a function of one more variable, which takes many more poses to know; so there
    are not as many as one can afford, but the fewest that are enough for the worst frame in one of the orders. By
    bisection: more coordinates hold more. Of the orders that is taken with which a run is expected to be less off;
    where no number is enough, so is the number, among those tried; and as long as that is worth it, larger ones are.

    Args:
        r: how many; None finds the fewest that are enough, or where none are, those with which a run is least off.

    Returns:
        (k, r), with orthonormal columns.
    """
    orders = {"largest": np.eye(run.basis.k), "slowest": slowest(run)}
    frames, tried = list(frames_of(run)), dict[tuple[int, str], Slaving]()
    with progress.bar("train: which coordinates", None, " tried") as bar:

        def enough(size: int) -> bool:
            for name, order in orders.items():
                tried[size, name] = slaving(Compliance(run.scene, combined(run.basis, order[:, :size])), frames)
                bar.say(f"the {size} {name} {tried[size, name]}")
                bar.update()
            return min(tried[size, name].worst for name in orders) <= ENOUGH

        sizes = [r] if r is not None else [size for size in SIZES if size < run.basis.k] or [run.basis.k]
        least = sizes[bisect_left(sizes[:-1], True, key=enough)]
        if (least, "largest") not in tried:
            enough(least)
        held = min(tried[least, name].worst for name in orders) <= ENOUGH
        known = [each for each in tried if each[0] == least or not held]
        best = min(known, key=lambda each: (tried[each].expected, -each[0]))
        for size in (each for each in LARGER if r is None and not held and each < run.basis.k):
            enough(size)
            more = min(((size, name) for name in orders), key=lambda each: tried[each].expected)
            if tried[more].expected > WORTH * tried[best].expected:
                break
            best = more
    size, name = best
    return np.ascontiguousarray(orders[name][:, :size])


def slowest(run: Run) -> Array:
    """The vibration modes in the span of the basis at rest, by ascending frequency, (k, k): eigenvectors of UᵀK₀U."""
    vectors: Array = np.linalg.eigh(reduced_rest_stiffness(run.scene, run.basis))[1]
    return vectors


def combined(basis: Basis, combinations: Array) -> Basis:
    """The basis of combinations (k, r) of the columns of another; orthonormal where both are."""
    return Basis.of(np.ascontiguousarray(basis.matrix @ combinations), basis.metric)


@dataclass(frozen=True, eq=False)
class Slaving:
    """How far frames are from the relaxed poses of their coordinates, and how much the stiffness S changes there.

    Attributes:
        off: (f,), the mean distance, a share of the mean displacement of that frame, or of all frames where that is
            larger; NaN where coordinates have no stable equilibrium, and infinite where no frame moves.
        change: (f,), ‖S₀^-½ S S₀^-½ − 1‖ / √r of the Frobenius norm; NaN where `off` is.
        r: how many coordinates.
    """

    off: Array
    change: Array
    r: int

    @property
    def worst(self) -> float:
        """Of the frames that have an equilibrium; where none has, infinite."""
        known = self.off[~np.isnan(self.off)]
        return float(known.max()) if len(known) else math.inf

    @property
    def mean(self) -> float:
        """Where one that has no equilibrium is all of its motion off."""
        return float(np.nan_to_num(self.off, nan=1.0).mean())

    @property
    def expected(self) -> float:
        """What coordinates and V_eff miss, to choose by; a frame at most all of its motion.

        It is no run's error: those of one solid were seven times as far off (docs/notebook/2026-11-26-coordinates.md).
        """
        missed = OF_CHANGE * (self.r / COORDINATES) ** 3 * self.change**2
        return float(np.minimum(np.nan_to_num(self.off + missed, nan=1.0), 1.0).mean())

    def __str__(self) -> str:
        return (
            f"miss a pull by {100 * self.mean:.2g} %, the worst by {100 * self.worst:.2g} %; "
            f"{100 * self.expected:.2g} % with what V_eff is expected to miss"
        )


def slaving(compliance: Compliance, frames: Iterable[tuple[Array, Loads]]) -> Slaving:
    """Relax frames of the full space at their coordinates.

    Loads act on what is slaved as they do when the space is stepped, by the residual compliance. What remains is what r
    coordinates lose, however well V_eff is known: fast motion, and compliance that changes as the solid bends. V_eff is
    the harder to know the more the stiffness changes.

    Args:
        frames: displacements of the full space, (n, 3) metres, with what acts.

    Returns:
        What is known of them, in their order.
    """
    values, vectors = np.linalg.eigh(compliance.relaxation.rest.stiffness)  # once, before there are threads
    to_rest = vectors / np.sqrt(values)
    found = in_threads(lambda frame: _relaxed_frame(compliance, to_rest, *frame), frames)
    off, moved, change = np.array(list(found)).reshape(-1, 3).T
    shares: Array = off / np.maximum(moved, moved.mean()) if moved.any() else np.full(len(off), math.inf)
    return Slaving(shares, change, len(to_rest))


def _relaxed_frame(compliance: Compliance, to_rest: Array, u: Array, loads: Loads) -> tuple[float, float, float]:
    """Of one frame: mean distance and mean displacement, metres, and the change of stiffness."""
    moved = float(np.linalg.norm(u, axis=1).mean())
    try:
        pose = compliance.relaxation.from_pose(u)
    except SolverError:
        return math.nan, moved, math.nan
    found = pose.u + compliance.sag(loads.gravity)
    for grab in loads.grabs:
        centre = (compliance.scene.mesh.vertices + u)[grab.vertices].mean(axis=0)
        found += compliance.moved(grab.vertices, pose.u, grab.stiffness * (grab.target - centre))
    change = to_rest.T @ pose.stiffness @ to_rest - np.eye(len(to_rest))
    distance = float(np.linalg.norm(found - u, axis=1).mean())
    return distance, moved, float(np.linalg.norm(change) / math.sqrt(len(change)))


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
