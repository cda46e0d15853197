"""The spaces side by side: the same motion in the full, the linear and the latent space, timed and judged.

Rules of measurement: one process, one thread, the same stop rule; each reduced space with the fastest of
its minimisers, found on a trial stretch that also serves as warm-up; errors against the full-space snapshots.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullState, FullStepper
from ldsim.dynamics.reduced.minimiser import Method
from ldsim.dynamics.reduced.stepper import Prescribed, ReducedState, ReducedStepper
from ldsim.dynamics.trajectory import Trajectory
from ldsim.mechanics.motion import GrabTracker, Motion
from ldsim.mechanics.scene import Scene
from ldsim.optimise.solution import Reason
from ldsim.simulator.loading import stop_of
from ldsim.space.basis import weighted
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder, nearest_latent
from ldsim.space.lifting import Lifting

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Held = Mapping[int, Indices]
Frames = Callable[[int, int], NDArray[np.floating]]

TRIAL_FRAMES = 60
TRIALS = 3
CHUNK = 64

# The minimisers that compete for each reduced space.
MINIMISERS: dict[str, tuple[Method, bool]] = {
    "L-BFGS, rest stiffness": (Method.LBFGS, False),
    "L-BFGS, current stiffness": (Method.LBFGS, True),
    "BFGS kept across steps": (Method.BFGS, True),
    "Newton": (Method.NEWTON, True),
}


class Restarts:
    """States of a reduced space taken from the full-space run every so many frames.

    Args:
        every: frames between restarts.
        state: the reduced state that continues after a frame of the full-space run (−1 is rest).
    """

    def __init__(self, every: int, state: Callable[[int], ReducedState]) -> None:
        self._every = every
        self._state = state

    def before(self, frame: int) -> ReducedState | None:
        """The state to start a frame from, or None to go on."""
        return self._state(frame - 1) if frame % self._every == 0 and frame > 0 else None


def run_reduced(
    stepper: ReducedStepper,
    scene: Scene,
    motion: Motion,
    held: Held,
    frames: range,
    restarts: Restarts | None = None,
    start: ReducedState | None = None,
    progress: Callable[[], object] | None = None,
) -> Trajectory:
    """Step through frames of a motion in a reduced space; a run that is lost ends in NaN.

    Raises:
        MotionError: the motion moves pins that the stepper was not prepared for.
    """
    a = (stepper.lifting or Lifting.of(scene, ())).coordinates(motion)
    tracker = GrabTracker(motion, scene.mesh.vertices, scene.movable, dict(held))
    state = start if start is not None else ReducedState.at_rest(stepper.decoder)
    count, decoder = len(frames), stepper.decoder
    q, z = np.full((count, decoder.k), np.nan), np.full((count, decoder.r), np.nan)
    counts = np.zeros((count, 3), dtype=np.int64)
    counts[:, 2] = Reason.INFINITE_START
    seconds = np.full(count, np.nan)
    limit = 10 * scene.mesh.diagonal * np.sqrt(float(scene.mass.sum()))
    for i, frame in enumerate(frames):
        state = (restarts.before(frame) if restarts is not None else None) or state
        u = None
        if tracker.needs_state(frame):
            u = stepper.displacement(state, Prescribed.of(a, frame - 1) if frame else None)
        grabs, gravity = tracker.grabs(frame, u), tracker.conditions(frame).gravity
        prescribed = Prescribed.of(a, frame)
        started = time.perf_counter()
        state, solution = stepper.step(state, grabs, gravity, prescribed)
        seconds[i] = time.perf_counter() - started
        counts[i] = solution.iterations, solution.evaluations, solution.reason
        if solution.reason == Reason.INFINITE_START or not np.linalg.norm(state.q) < limit:
            break
        q[i], z[i] = state.q, state.z
        if progress is not None:
            progress()
    latent = None if decoder.is_identity else z
    return Trajectory(counts[:, 0], counts[:, 1], counts[:, 2], seconds, q, latent)


def run_full(
    scene: Scene, motion: Motion, held: Held, frames: range, before: tuple[Array, Array], tolerance: float
) -> Trajectory:
    """Step through frames of a motion in the full space from the displacements of the two frames before, (n, 3)."""
    stepper = FullStepper(scene, FullOptions(tolerance=tolerance))
    tracker = GrabTracker(motion, scene.mesh.vertices, scene.movable, dict(held))
    state = FullState(before[0], before[1], before[0])
    counts = np.zeros((len(frames), 3), dtype=np.int64)
    seconds = np.zeros(len(frames))
    stepper.step(state, tracker.grabs(frames[0], state.u), tracker.conditions(frames[0]))
    for i, frame in enumerate(frames):
        grabs, conditions = tracker.grabs(frame, state.u), tracker.conditions(frame)
        started = time.perf_counter()
        state, solution = stepper.step(state, grabs, conditions)
        seconds[i] = time.perf_counter() - started
        counts[i] = solution.iterations, solution.evaluations, solution.reason
    return Trajectory(counts[:, 0], counts[:, 1], counts[:, 2], seconds)


def stretch(motion: Motion, count: int) -> range:
    """The `count` frames from the first grab on, or as many as there are."""
    first = min((drag.start for drag in motion.drags), default=0)
    first = min(first, max(motion.frames - count, 0))
    return range(first, min(first + count, motion.frames))


def fastest(
    make: Callable[[Method, bool], ReducedStepper], scene: Scene, motion: Motion, held: Held
) -> tuple[str, ReducedStepper]:
    """The minimiser with the least median step on a trial stretch where no step fails; ties go to fewer failures.

    They are tried in turns, and the least of each counts: a machine may be half as fast for a second.
    """
    frames = range(stretch(motion, TRIAL_FRAMES).stop)
    steppers = {name: make(*minimiser) for name, minimiser in MINIMISERS.items()}
    failed, least = dict.fromkeys(steppers, 0), dict.fromkeys(steppers, np.inf)
    for stepper in steppers.values():
        run_reduced(stepper, scene, motion, held, frames[:2])
    for name, stepper in TRIALS * list(steppers.items()):
        trial = run_reduced(stepper, scene, motion, held, frames)
        part = trial.seconds[-TRIAL_FRAMES:]
        failed[name] = int((trial.reason != Reason.CONVERGED).sum())
        least[name] = min(least[name], float(np.nanmedian(part)) if np.isfinite(part).any() else np.inf)
    best = min(steppers, key=lambda name: (failed[name], least[name]))
    return best, steppers[best]


def with_errors(
    trajectory: Trajectory,
    U: Array,
    snapshots: Callable[[int, int], NDArray[np.float32]],
    windowed: Trajectory,
    lifted: Frames | None = None,
) -> Trajectory:
    """The trajectory with its vertex distances to the full-space snapshots, uninterrupted and windowed.

    Args:
        snapshots: frames start … stop − 1 of the full-space run, (frames, n, 3), metres.
        lifted: the same of what moving pins prescribe; None where all stand still.
    """
    assert trajectory.coordinates is not None and windowed.coordinates is not None
    columns: list[Array] = []
    for start in range(0, len(trajectory.coordinates), CHUNK):
        part = slice(start, min(start + CHUNK, len(trajectory.coordinates)))
        full = snapshots(part.start, part.stop)
        relative = full if lifted is None else full - lifted(part.start, part.start + len(full))
        distance = _distances(trajectory.coordinates[part], U, relative)
        again = _distances(windowed.coordinates[part], U, relative)
        moved = np.linalg.norm(full.astype(np.float64), axis=2)
        columns.append(np.array([distance.mean(axis=1), distance.max(axis=1), again.mean(axis=1), moved.mean(axis=1)]))
    mean, largest, windowed_mean, moved_mean = np.concatenate(columns, axis=1)
    return replace(
        trajectory,
        mean_error=mean,
        max_error=largest,
        windowed_mean_error=windowed_mean,
        mean_displacement=moved_mean,
    )


def _distances(q: Array, U: Array, full: NDArray[np.floating]) -> Array:
    """Vertex distances between U q and the snapshots, (frames, n) metres; infinite where q is not finite."""
    distance: Array = np.linalg.norm((q @ U.T).reshape(full.shape) - full, axis=2)
    distance[~np.isfinite(q).all(axis=1)] = np.inf
    return distance


@dataclass(frozen=True, eq=False)
class ReducedSpace:
    """A reduced space to compare: its name, basis (3n, k), decoder, encoder and cubature."""

    name: str
    U: Array
    decoder: Decoder
    encoder: Encoder
    cubature: CubatureRule

    def stepper(
        self,
        scene: Scene,
        tolerance: float,
        max_iterations: int,
        method: Method,
        current: bool,
        lifting: Lifting | None = None,
    ) -> ReducedStepper:
        """What steps a scene in this space; the arguments are those of `ReducedStepper`."""
        return ReducedStepper(
            scene,
            self.U,
            self.decoder,
            self.cubature,
            tolerance=tolerance,
            max_iterations=max_iterations,
            method=method,
            current=current,
            lifting=lifting,
        )

    def state(self, metric: csr_array, u: Array, u_previous: Array) -> ReducedState:
        """The reduced state nearest to the displacements of two frames, each (n, 3); q keeps their projections."""
        q = weighted(metric, np.stack([u.ravel(), u_previous.ravel()])) @ self.U
        guesses = self.encoder(q)
        z = [nearest_latent(self.decoder, target, guess) for target, guess in zip(q, guesses, strict=True)]
        return ReducedState.moving(z[0], z[1], q[0], q[1])


def windowed_error(
    scene: Scene, metric: csr_array, space: ReducedSpace, motion: Motion, held: Held, snapshots: Frames, window: float
) -> float:
    """Online error of a motion that is restarted from its snapshots every window of so many seconds."""
    lifting = Lifting.of(scene, [motion])
    lifted = lifting.displacements(motion) if lifting.count else None
    stepper = space.stepper(scene, stop_of(scene), 200, Method.BFGS, True, lifting)
    restarts = restarts_every(scene, metric, space, _without(snapshots, lifted), window)
    run = run_reduced(stepper, scene, motion, held, range(motion.frames), restarts)
    judged = with_errors(run, space.U, snapshots, run, lifted)
    assert judged.mean_error is not None and judged.mean_displacement is not None
    return float(judged.mean_error.sum() / judged.mean_displacement.sum())


@dataclass(frozen=True)
class Options:
    """Settings of a comparison, as `settings.SimulateSettings` declares them."""

    tolerance: float
    max_iterations: int
    full_frames: int
    window: float


def compare_motion(
    scene: Scene,
    metric: csr_array,
    spaces: Sequence[ReducedSpace],
    motion: Motion,
    held: Held,
    snapshots: Frames | None,
    options: Options,
    progress: Callable[[], object],
) -> Iterator[tuple[str, Trajectory, str]]:
    """Run one motion in the full space (a stretch, for its time) and in each reduced space (whole, and windowed).

    Without snapshots, as with a material that no full-space run had, the full space is run from rest up to the end of
    the stretch, and nothing is judged or windowed.

    Yields the space's name, its trajectory and its minimiser.
    """
    timed, lifting = stretch(motion, options.full_frames), Lifting.of(scene, [motion])
    lifted = lifting.displacements(motion) if lifting.count else None
    yield "full", _full_stretch(scene, motion, held, timed, snapshots, options.tolerance), "L-BFGS, turned factor"
    for space in spaces:

        def make(method: Method, current: bool, space: ReducedSpace = space) -> ReducedStepper:
            return space.stepper(scene, options.tolerance, options.max_iterations, method, current, lifting)

        name, stepper = fastest(make, scene, motion, held)
        whole = range(motion.frames)
        trajectory = run_reduced(stepper, scene, motion, held, whole, progress=progress)
        if snapshots is not None:
            restarts = restarts_every(scene, metric, space, _without(snapshots, lifted), options.window)
            windowed = run_reduced(stepper, scene, motion, held, whole, restarts, progress=progress)
            trajectory = with_errors(trajectory, space.U, snapshots, windowed, lifted)
        yield space.name, trajectory, name


def _without(snapshots: Frames, lifted: Frames | None) -> Frames:
    """The frames less what moving pins prescribe in them."""
    return snapshots if lifted is None else lambda start, stop: snapshots(start, stop) - lifted(start, stop)


def _displacement(scene: Scene, snapshots: Frames, frame: int) -> Array:
    """The full space after a frame, (n, 3) float64; rest before the first."""
    if frame < 0:
        return np.zeros((scene.mesh.n_vertices, 3))
    return np.asarray(snapshots(frame, frame + 1)[0], dtype=np.float64)


def _full_stretch(
    scene: Scene, motion: Motion, held: Held, timed: range, snapshots: Frames | None, tolerance: float
) -> Trajectory:
    """The frames of a stretch in the full space, started from its snapshots or, without, run up to from rest."""
    if snapshots is not None:
        before = tuple(_displacement(scene, snapshots, timed.start - back) for back in (1, 2))
        return run_full(scene, motion, held, timed, (before[0], before[1]), tolerance)
    rest = np.zeros((scene.mesh.n_vertices, 3))
    whole = run_full(scene, motion, held, range(timed.stop), (rest, rest), tolerance)
    part = slice(timed.start, None)
    return Trajectory(whole.iterations[part], whole.evaluations[part], whole.reason[part], whole.seconds[part])


def restarts_every(scene: Scene, metric: csr_array, space: ReducedSpace, snapshots: Frames, window: float) -> Restarts:
    """Restarts of a reduced space from the snapshots, every window of so many seconds."""

    def state(i: int) -> ReducedState:
        return space.state(metric, _displacement(scene, snapshots, i), _displacement(scene, snapshots, i - 1))

    return Restarts(max(round(window / scene.time_step), 1), state)
