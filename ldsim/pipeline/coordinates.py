"""How many coordinates a condensed space needs: few, for what they do not show is in equilibrium with them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from ldsim.arrays import Array
from ldsim.errors import SolverError
from ldsim.mechanics.loads import Loads, MotionLoads
from ldsim.pipeline.progress import Progress
from ldsim.run import Run
from ldsim.space.compliance import Compliance

# Dimensions that are tried, for more are better only with more samples than are relaxed by default; what is enough of
# the worst frame, its mean error over its mean displacement; and frames that are looked at. Where a solid is next to
# buckling, a run is ten times as far off as the relaxed poses are: a ring 12 % where its poses were 1.8 % off (r 4),
# 8 % where they were 0.4 % off (r 8), and 3 % where they were 0.2 % off (r 12).
SIZES, ENOUGH, FRAMES = (4, 6, 8, 10, 12, 16), 0.0025, 24


def needed_coordinates(run: Run, progress: Progress) -> int:
    """The least r whose relaxed poses are the frames of the training motions.

    Every further coordinate makes V_eff a function of one more variable, which takes many more poses to know; so r is
    not the largest that one can afford, but the smallest that is enough. By bisection: more coordinates hold more.
    """
    sizes = [r for r in SIZES if r < run.basis.k] or [run.basis.k]
    low, high = 0, len(sizes) - 1
    with progress.bar("train: how many coordinates", None, " tried") as bar:
        while low < high:
            middle = (low + high) // 2
            error = slaving_error(Compliance(run.scene, run.basis.columns(sizes[middle])), frames_of(run))
            bar.say(f"{sizes[middle]} miss the worst pull by {100 * error:.2g} %")
            bar.update()
            low, high = (low, middle) if error <= ENOUGH else (middle + 1, high)
    return sizes[low]


def slaving_error(compliance: Compliance, frames: Iterable[tuple[Array, Loads]]) -> float:
    """How far frames are from the relaxed poses of their coordinates: the worst one's mean distance.

    Loads act on what is slaved as they do when the space is stepped, by the residual compliance. What remains is what r
    coordinates lose, however well V_eff is known: fast motion, and compliance that changes as the solid bends.

    Args:
        frames: displacements of the full space, (n, 3) metres, with what acts.

    Returns:
        A share of the mean displacement of that frame, or of all frames where that is larger.
    """
    found = [_off(compliance, u, loads) for u, loads in frames]
    off, moved = np.array([each for each in found if each is not None]).reshape(-1, 2).T
    return float((off / np.maximum(moved, moved.mean())).max()) if moved.any() else math.inf


def _off(compliance: Compliance, u: Array, loads: Loads) -> tuple[float, float] | None:
    """Mean distance and mean displacement, metres, of one frame; None where it has no equilibrium."""
    try:
        relaxed = compliance.relaxation.from_pose(u).u
    except SolverError:
        return None
    found = relaxed + compliance.sag(loads.gravity)
    for grab in loads.grabs:
        centre = (compliance.scene.mesh.vertices + u)[grab.vertices].mean(axis=0)
        found += compliance.moved(grab.vertices, relaxed, grab.stiffness * (grab.target - centre))
    return float(np.linalg.norm(found - u, axis=1).mean()), float(np.linalg.norm(u, axis=1).mean())


def frames_of(run: Run, role: str = "train") -> Iterator[tuple[Array, Loads]]:
    """Frames of the motions of a role, (n, 3) metres, with what acts: where pulls end, or spread where they are few."""
    names = run.snapshots.with_role(role)
    of_each = -(-FRAMES // len(names))
    for name in names:
        recorded, read = run.snapshots.recorded(name), run.snapshots.reader(name)
        loads = MotionLoads(recorded.motion, run.scene, dict(recorded.held))
        count = run.snapshots.frames(name)
        ends = [drag.start + len(drag.targets) - 1 for drag in recorded.motion.drags]
        frames = np.array(
            ends if len(ends) >= of_each // 2 else np.linspace(0, count - 1, of_each + 2)[1:-1], dtype=int
        )
        some = np.linspace(0, len(frames) - 1, min(of_each, len(frames))).astype(int)
        for frame in np.unique(frames[some]).tolist():
            yield np.asarray(read(frame, frame + 1)[0], dtype=np.float64), loads.at(frame, None)
