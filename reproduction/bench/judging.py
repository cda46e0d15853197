"""How far a reduced space is off on a motion, stepped as a user would step it."""

from __future__ import annotations

from scipy.sparse import csr_array

from ldsim.artefacts.snapshots import Recorded
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.mechanics.scene import Scene
from ldsim.pipeline.comparison import Frames, ReducedSpace, restarts_every, run_reduced, with_errors

WINDOW = 0.25


def errors(
    scene: Scene, space: ReducedSpace, stepper: ReducedStepper, recorded: Recorded, frames: Frames, metric: csr_array
) -> tuple[float, float]:
    """Online error of a motion, whole and restarted every window."""
    motion = recorded.motion
    whole = run_reduced(stepper, scene, motion, recorded.held, range(motion.frames))
    restarts = restarts_every(scene, metric, space, frames, WINDOW)
    windowed = run_reduced(stepper, scene, motion, recorded.held, range(motion.frames), restarts)
    judged = with_errors(whole, space.U, frames, windowed)
    assert judged.mean_error is not None and judged.mean_displacement is not None
    assert judged.windowed_mean_error is not None
    moved = judged.mean_displacement.sum()
    return float(judged.mean_error.sum() / moved), float(judged.windowed_mean_error.sum() / moved)
