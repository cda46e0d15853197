"""Synthetic motions: run in the linear space of a whole basis, thousands of frames where the full space makes a few.

The basis holds far more motions than those it was made from; what an autoencoder learns is which of its poses belong
together, and that takes many. A step in k coordinates with a cubature takes about a millisecond.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock

import numpy as np

from ldsim.arrays import Array
from ldsim.cubature.choose import drawn_candidates, split_poses
from ldsim.cubature.methods import fit
from ldsim.cubature.options import FitOptions
from ldsim.cubature.path import Tell
from ldsim.cubature.samples import PoseSpace, rest_compliance
from ldsim.cubature.system import System
from ldsim.cubature.terms import ForceTerm
from ldsim.dynamics.reduced.matrices import reduced_rest_stiffness
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.jit import in_threads
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.scene import Scene
from ldsim.space.basis import Basis
from ldsim.space.space import Space

# The cubature rule is fitted to so many poses.
POSES, FIT = 300, FitOptions(tolerance=0.03, max_points=1000)
# Steps stop at ‖∇E‖ ≤ this · max(‖q‖, 1), N.
TOLERANCE = 1e-4


def synthetic_stepper(scene: Scene, basis: Basis, q: Array, seed: int, progress: Tell | None = None) -> ReducedStepper:
    """What steps a scene in the linear space of a whole basis, with a cubature fitted to snapshots q, (N, k).

    Args:
        seed: of the choice of snapshots.
        progress: told the points and the relative error of each rule of the fit.
    """
    poses, _ = split_poses(len(q), min(POSES, len(q)), 0, seed)
    stiffness = reduced_rest_stiffness(scene, basis)
    space = Space.linear(scene, basis, basis.k)
    samples = PoseSpace(space, stiffness, q[poses])
    metric = rest_compliance(stiffness, space.decoder, q[:1])
    candidates = drawn_candidates(scene.points.n_points, FIT)
    forces = ForceTerm(samples, samples.samples(samples.z, poses), metric, candidates)
    found = fit(System(forces, FIT.terms.volume, candidates), FIT, progress).best
    return ReducedStepper(space.with_rule(found), ReducedOptions(tolerance=TOLERANCE))


def synthetic_frames(
    stepper: ReducedStepper, motion: Motion, tell: Callable[[], object], together: int | None = None
) -> Array:
    """Coordinates of the frames of a motion, (N, k) float64; where a run is lost, of the frames before.

    Args:
        motion: whose grabs and gravity are stepped, with all pins at rest.
        tell: called after each frame.
        together: frames that are run one after another; then the solid is at rest again. None for all of them.
            Such runs are shared out on the cores, on which the result does not depend.
    """
    lock = Lock()

    def run(frames: range) -> Array:
        q = []
        for frame in simulate(stepper, motion, frames=frames):
            if frame.lost:
                break
            q.append(frame.state.q)
            with lock:
                tell()
        return np.array(q).reshape(-1, stepper.space.decoder.k)

    length = together or motion.frames
    runs = [range(start, min(start + length, motion.frames)) for start in range(0, motion.frames, length)]
    return np.concatenate([np.empty((0, stepper.space.decoder.k)), *in_threads(run, runs)])
