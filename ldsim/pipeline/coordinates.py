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

# Dimensions that are tried, for more are better only with more samples than are relaxed by default; what is enough, as
# the mean error over the mean displacement; and frames that are looked at.
SIZES, ENOUGH, FRAMES = (4, 6, 8, 10, 12), 0.015, 16


def needed_coordinates(run: Run, progress: Progress) -> int:
    """The least r whose relaxed poses are the frames of the training motions.

    Every further coordinate makes V_eff a function of one more variable, which takes many more poses to know; so r is
    not the largest that one can afford, but the smallest that is enough. By bisection: more coordinates hold more.
    """
    sizes = [r for r in SIZES if r < run.basis.k] or [run.basis.k]
    low, high = 0, len(sizes) - 1
    with progress.bar("train: coordinates", None, "size") as bar:
        while low < high:
            middle = (low + high) // 2
            error = slaving_error(Compliance(run.scene, run.basis.columns(sizes[middle])), frames_of(run))
            bar.say(f"r = {sizes[middle]}: {100 * error:.2g} %")
            bar.update()
            low, high = (low, middle) if error <= ENOUGH else (middle + 1, high)
    return sizes[low]


def slaving_error(compliance: Compliance, frames: Iterable[tuple[Array, Loads]]) -> float:
    """How far frames are from the relaxed poses of their coordinates, mean distance over mean displacement.

    Loads act on what is slaved as they do when the space is stepped, by the residual compliance. What remains is what r
    coordinates lose, however well V_eff is known: fast motion, and compliance that changes as the solid bends.

    Args:
        frames: displacements of the full space, (n, 3) metres, with what acts.
    """
    off, moved = 0.0, 0.0
    for u, loads in frames:
        try:
            found = compliance.relaxation.from_pose(u).u + compliance.sag(loads.gravity)
        except SolverError:
            continue
        for grab in loads.grabs:
            centre = (compliance.scene.mesh.vertices + u)[grab.vertices].mean(axis=0)
            found += compliance.moved(grab.vertices, u, grab.stiffness * (grab.target - centre))
        off += float(np.linalg.norm(found - u, axis=1).mean())
        moved += float(np.linalg.norm(u, axis=1).mean())
    return off / moved if moved > 0 else math.inf


def frames_of(run: Run) -> Iterator[tuple[Array, Loads]]:
    """Frames spread over the training motions, (n, 3) metres, with what acts in them."""
    names = run.snapshots.with_role("train")
    of_each = -(-FRAMES // len(names))
    for name in names:
        recorded, read = run.snapshots.recorded(name), run.snapshots.reader(name)
        loads = MotionLoads(recorded.motion, run.scene, dict(recorded.held))
        count = run.snapshots.frames(name)
        for frame in np.unique(np.linspace(0, count - 1, of_each + 2).astype(int)[1:-1]).tolist():
            yield np.asarray(read(frame, frame + 1)[0], dtype=np.float64), loads.at(frame, None)
