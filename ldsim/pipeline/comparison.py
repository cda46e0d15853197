"""The spaces side by side: the same motion in the full, the linear and the latent space, timed and judged.

Rules of measurement: one process, one thread, the same stop rule; each reduced space with the fastest of
its minimisers, found on a trial stretch that also serves as warm-up; errors against the full-space snapshots.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullState, FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import Frame, simulate
from ldsim.dynamics.trajectory import Trajectory
from ldsim.mechanics.loads import MotionLoads
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.scene import Scene
from ldsim.optimise.solution import Reason
from ldsim.space.lifting import Lifting
from ldsim.space.space import Space

Frames = Callable[[int, int], NDArray[np.floating]]

TRIAL_FRAMES = 60
TRIALS = 3
CHUNK = 64

# The minimisers that compete for each reduced space.
MINIMISERS: dict[str, Mapping[str, str | bool]] = {
    "L-BFGS, rest stiffness": {"method": "lbfgs", "current": False},
    "L-BFGS, current stiffness": {"method": "lbfgs"},
    "BFGS kept across steps": {"method": "bfgs"},
    "Newton": {"method": "newton"},
}


@dataclass(frozen=True, eq=False)
class Reference:
    """A motion as it ran in the full space, for reduced runs of it to be judged by.

    Attributes:
        held: vertices of each drag.
        frames: (start, stop) → displacements of frames start … stop − 1, (frames, n, 3), metres; None where no
            full-space run is known, as with another material.
    """

    motion: Motion
    held: Mapping[int, Indices]
    frames: Frames | None

    def displacement(self, scene: Scene, frame: int) -> Array:
        """The full space after a frame, (n, 3) float64; rest before the first."""
        if frame < 0 or self.frames is None:
            return np.zeros((scene.mesh.n_vertices, 3))
        return np.asarray(self.frames(frame, frame + 1)[0], dtype=np.float64)


def run_reduced(
    stepper: ReducedStepper,
    reference: Reference,
    frames: range | None = None,
    restarts: Sequence[int] | None = None,
    progress: Callable[[], object] | None = None,
) -> Trajectory:
    """Step through frames of a motion in a reduced space; a run that is lost ends in NaN.

    Args:
        frames: which; all where it is left out.
        restarts: frames, increasing, at which all of the motion is started anew from the full-space run; the first
            is 0.
    """
    every = range(reference.motion.frames) if frames is None else frames
    made = simulate(stepper, reference.motion, frames=every, held=reference.held)
    if restarts is not None:
        made = _restarted(stepper, reference, restarts)
    return _recorded(made, len(every), stepper.space, progress)


def _restarted(stepper: ReducedStepper, reference: Reference, restarts: Sequence[int]) -> Iterator[Frame[ReducedState]]:
    """The frames of a motion, started anew from the full-space run at some of them."""
    motion, held, scene = reference.motion, reference.held, stepper.scene
    loads = MotionLoads(motion, scene, dict(held))
    for first, stop in pairwise([*restarts, motion.frames]):
        start = None
        if first:
            u = [reference.displacement(scene, first - back) for back in (1, 2)]
            pins = [loads.pins(first - back) if first >= back else () for back in (1, 2)]
            start = stepper.state(u[0], u[1], (pins[0], pins[1]))
        state = stepper.rest() if start is None else start
        for frame in simulate(stepper, motion, start, range(first, stop), held):
            if frame.lost:  # this window alone: its last good shape is held to its end, and judged there
                solution = frame.solution._replace(reason=Reason.INFINITE_START)  # as all frames of a run that is lost
                held_still = frame._replace(state=state, solution=solution, lost=False)
                yield from (held_still._replace(number=i) for i in range(frame.number, stop))
                break
            state = frame.state
            yield frame


def _recorded(
    frames: Iterable[Frame[ReducedState]], count: int, space: Space, progress: Callable[[], object] | None = None
) -> Trajectory:
    """What a reduced run came to; NaN from the frame on in which it was lost."""
    q, z = np.full((count, space.decoder.k), np.nan), np.full((count, space.decoder.r), np.nan)
    counts, seconds = np.zeros((count, 3), dtype=np.int64), np.full(count, np.nan)
    counts[:, 2] = Reason.INFINITE_START
    for i, frame in enumerate(frames):
        counts[i] = frame.solution.iterations, frame.solution.evaluations, frame.solution.reason
        seconds[i] = frame.seconds
        if frame.lost:
            break
        q[i], z[i] = frame.state.q, frame.state.z
        if progress is not None:
            progress()
    latent = None if space.decoder.is_identity else z
    return Trajectory(counts[:, 0], counts[:, 1], counts[:, 2], seconds, q, latent)


def run_full(scene: Scene, reference: Reference, frames: range, options: FullOptions) -> Trajectory:
    """Step through some frames of a motion in the full space, for its time.

    It starts from the full-space run, or where none is known from rest, and then runs up to the frames first.
    """
    stepper = FullStepper(scene, options)
    motion, held = reference.motion, reference.held
    if reference.frames is None:
        run, start = range(frames.stop), stepper.rest()
    else:
        run = frames
        start = FullState.moving(*(reference.displacement(scene, frames.start - back) for back in (1, 2)))
    # the first step once more than it counts: it compiles, and factorises for the first time
    next(simulate(stepper, motion, start, run, held))
    made = list(simulate(stepper, motion, start, run, held))[-len(frames) :]
    counts = np.array([[f.solution.iterations, f.solution.evaluations, f.solution.reason] for f in made])
    return Trajectory(counts[:, 0], counts[:, 1], counts[:, 2], np.array([f.seconds for f in made]))


def stretch(motion: Motion, count: int) -> range:
    """The `count` frames from the first grab on, or as many as there are."""
    first = min((drag.start for drag in motion.drags), default=0)
    first = min(first, max(motion.frames - count, 0))
    return range(first, min(first + count, motion.frames))


def fastest(
    space: Space,
    reference: Reference,
    options: ReducedOptions,
    minimisers: Mapping[str, Mapping[str, str | bool]] = MINIMISERS,
) -> tuple[str, ReducedStepper]:
    """The minimiser with the least median step on a trial stretch where no step fails; ties go to fewer failures.

    They are tried in turns, and the least of each counts: a machine may be half as fast for a second.

    Args:
        options: whose tolerance, most iterations and inertia hold for all.
        minimisers: name → what it has as `MinimiserOptions`.
    """
    frames = range(stretch(reference.motion, TRIAL_FRAMES).stop)
    names = ("tolerance", "max_iterations", "quasistatic")
    common = {name: getattr(options, name) for name in names}
    steppers = {
        name: ReducedStepper(space, ReducedOptions.model_validate({**kind, **common}))
        for name, kind in minimisers.items()
    }
    failed, least = dict.fromkeys(steppers, 0), dict.fromkeys(steppers, np.inf)
    for stepper in steppers.values():
        run_reduced(stepper, reference, frames[:2])
    for name, stepper in TRIALS * list(steppers.items()):
        trial = run_reduced(stepper, reference, frames)
        late = trial.seconds[-TRIAL_FRAMES:]
        failed[name] = int((trial.reason != Reason.CONVERGED).sum())
        least[name] = min(least[name], float(np.nanmedian(late)) if np.isfinite(late).any() else np.inf)
    best = min(steppers, key=lambda name: (failed[name], least[name]))
    return best, steppers[best]


def with_errors(
    trajectory: Trajectory, space: Space, reference: Reference, windowed: Trajectory | None = None
) -> Trajectory:
    """The trajectory with its vertex distances to the full-space run.

    Args:
        windowed: the same motion in windows; None where the trajectory itself is it, or none is asked for.
    """
    assert trajectory.coordinates is not None and reference.frames is not None
    assert windowed is None or windowed.coordinates is not None
    lifted = None
    if space.lifting is not None and space.lifting.count:
        lifted = space.lifting.displacements(reference.motion)
    residual = residuals(space, reference)
    columns: list[Array] = []
    for start in range(0, len(trajectory.coordinates), CHUNK):
        some = slice(start, min(start + CHUNK, len(trajectory.coordinates)))
        full = reference.frames(some.start, some.stop)
        relative = full if lifted is None else full - lifted(some.start, some.start + len(full))
        q = trajectory.coordinates[some]
        distance = again = _distances(q, space, relative - residual(some.start, q))
        if windowed is not None and windowed.coordinates is not None:
            q_again = windowed.coordinates[some]
            again = _distances(q_again, space, relative - residual(some.start, q_again))
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


def residuals(space: Space, reference: Reference) -> Callable[[int, Array], Array]:
    """(first frame, q of frames from it on) → what a condensed space moves beside U q, (frames, n, 3), metres."""
    if not space.is_condensed:
        return lambda start, q: np.zeros((len(q), 1, 1))
    stepper, loads = ReducedStepper(space), MotionLoads(reference.motion, space.scene, dict(reference.held))

    def residual(start: int, q: Array) -> Array:
        return np.stack([stepper.residual(row, loads.at(start + i, None)) for i, row in enumerate(q)])

    return residual


def _distances(q: Array, space: Space, full: NDArray[np.floating]) -> Array:
    """Vertex distances between U q and the snapshots, (frames, n) metres; infinite where q is not finite."""
    distance: Array = np.linalg.norm(space.displacement(q) - full, axis=2)
    distance[~np.isfinite(q).all(axis=1)] = np.inf
    return distance


def windowed_error(
    space: Space, reference: Reference, window: float, options: ReducedOptions = ReducedOptions()
) -> tuple[float, float]:
    """Of a motion that is restarted from its full-space run every window of so many seconds: how far it is off, and how
    far it goes, each the mean over vertices summed over the frames, metres."""
    space = space.with_lifting(Lifting.of(space.scene, [reference.motion]))
    run = run_reduced(
        ReducedStepper(space, options), reference, restarts=restarts_every(reference.motion, space.scene, window)
    )
    judged = with_errors(run, space, reference)
    assert judged.mean_error is not None and judged.mean_displacement is not None
    return float(judged.mean_error.sum()), float(judged.mean_displacement.sum())


def restarts_every(motion: Motion, scene: Scene, window: float) -> range:
    """Frames at which windows of so many seconds, of one frame at least, begin."""
    return range(0, motion.frames, max(round(window / scene.time_step), 1))


@dataclass(frozen=True)
class Measured:
    """What is run and timed of a motion.

    Attributes:
        full_frames: frames of the full space.
        full_tolerance: with which it is run, N.
        window: seconds between restarts from the full space, for the windowed error.
        minimisers: that compete for each reduced space; see `fastest`.
    """

    full_frames: int
    full_tolerance: float
    window: float
    minimisers: Mapping[str, Mapping[str, str | bool]] = field(default_factory=lambda: MINIMISERS)


def compare_motion(
    spaces: Sequence[Space],
    reference: Reference,
    options: ReducedOptions,
    measured: Measured,
    progress: Callable[[], object],
) -> Iterator[tuple[str, Trajectory, str]]:
    """Run one motion in the full space (a stretch, for its time) and in each reduced space (whole, and windowed).

    Without a full-space run, as with a material that no snapshot had, nothing is judged or windowed.

    Yields the space's name, its trajectory and its minimiser.
    """
    scene = spaces[0].scene
    of_full = FullOptions(tolerance=measured.full_tolerance, quasistatic=options.quasistatic)
    full = run_full(scene, reference, stretch(reference.motion, measured.full_frames), of_full)
    yield "full", full, "L-BFGS, warped factor"
    lifting = Lifting.of(scene, [reference.motion])
    for space in (space.with_lifting(lifting) for space in spaces):
        name, stepper = fastest(space, reference, options, measured.minimisers)
        trajectory = run_reduced(stepper, reference, progress=progress)
        if reference.frames is not None:
            restarts = restarts_every(reference.motion, scene, measured.window)
            windowed = run_reduced(stepper, reference, restarts=restarts, progress=progress)
            trajectory = with_errors(trajectory, space, reference, windowed)
        yield space.name, trajectory, name
