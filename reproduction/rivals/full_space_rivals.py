"""One frame of the full space by rival solvers, from the same states: a part of bench/full_space.py."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from tqdm import tqdm

from ldsim.dynamics.full.linear_choice import choose
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.potential import IncrementalPotential
from ldsim.dynamics.full.preconditioner import WarpedHessian
from ldsim.dynamics.full.stepper import FullState, FullStepper
from ldsim.mechanics.loads import Loads, MotionLoads
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.scene import Scene
from ldsim.optimise.minimiser import minimise
from ldsim.optimise.solution import Solution
from reproduction.harness import Row, row
from reproduction.rivals.scikit_fem_step import ScikitFemStepper

Step = Callable[[FullState, Loads], tuple[FullState, Solution]]

# Frames before the first drag, for which nothing is noted: kernels are loaded, caches are filled.
WARM_UP = 3
OURS = "ldsim"
# Names of the rivals, and how many times ours a mean frame of theirs shall take.
GOALS = {"L-BFGS, Hessian at rest": ">= 3", "scikit-fem and SciPy, Newton": ">= 5"}


class RestStepper:
    """L-BFGS preconditioned by the Hessian at rest, as the paper's text has it; the same stop rule and line search."""

    def __init__(self, scene: Scene, tolerance: float) -> None:
        rest = np.zeros((scene.mesh.n_vertices, 3))
        self._scene, self._tolerance = scene, tolerance
        self._hessian = WarpedHessian(scene, choose(scene, "direct"), exact=False)
        self._hessian.factorise(rest)
        self._hessian.prepare(rest, [])

    def step(self, state: FullState, loads: Loads) -> tuple[FullState, Solution]:
        """The state after a step, and the minimiser's record."""
        predictor = 2 * state.u - state.u_previous
        potential = IncrementalPotential(self._scene, predictor, loads.grabs, loads.gravity)
        x, scratch = predictor.ravel().copy(), np.empty(predictor.size)
        if not potential.value_gradient(x, scratch) < potential.value_gradient(state.u.ravel(), scratch):
            x = state.u.ravel().copy()
        solution = minimise(potential.value_gradient, x, self._hessian.solve, self._tolerance, max_iterations=2000)
        if not solution.converged:
            raise RuntimeError(f"L-BFGS with the Hessian at rest: {solution.reason.words}")
        return FullState.moving(x.reshape(-1, 3), state.u), solution


@dataclass
class Record:
    """What a solver took for each frame.

    Attributes:
        apart: the farthest that a vertex was from where ours was, m.
    """

    seconds: list[float] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)
    apart: float = 0.0

    def add(self, seconds: float, iterations: int, apart: float) -> None:
        self.seconds.append(seconds)
        self.iterations.append(iterations)
        self.apart = max(self.apart, apart)


def race(scene: Scene, motion: Motion, count: int, tolerance: float) -> tuple[dict[str, Record], int]:
    """Every solver on the first frames of the first drag, each frame from the two states that ours had before it.

    Ours keeps its factor from frame to frame, as in a run, and the time of making new ones is in its frames; what the
    rivals prepare once is not in theirs. Returns also how often ours made a factor in those frames.
    """
    rivals: dict[str, Step] = dict(
        zip(GOALS, (RestStepper(scene, tolerance).step, ScikitFemStepper(scene, tolerance).step), strict=True)
    )
    records = {name: Record() for name in (OURS, *rivals)}
    stepper = FullStepper(scene, FullOptions(tolerance=tolerance))
    state = stepper.rest()
    loads = MotionLoads(motion, scene)
    first, made = motion.drags[0].start, 0
    for frame in tqdm(range(first - WARM_UP, first + count), desc="rivals", unit="frame"):
        before, acting = state, loads.at(frame, state.u)
        started = time.perf_counter()
        state, solution = stepper.step(before, acting)
        taken = {OURS: (time.perf_counter() - started, solution.iterations, 0.0)}
        for name, step in rivals.items():
            started = time.perf_counter()
            other, theirs = step(before, acting)
            seconds = time.perf_counter() - started
            taken[name] = seconds, theirs.iterations, float(np.linalg.norm(other.u - state.u, axis=1).max())
        if frame < first:
            made = stepper.factorisations
            continue
        for name, (seconds, iterations, apart) in taken.items():
            records[name].add(seconds, iterations, apart)
    return records, stepper.factorisations - made


def measure(model: str, scene: Scene, motion: Motion, count: int, tolerance: float) -> list[Row]:
    """The rows of the rivals."""
    records, factorisations = race(scene, motion, count, tolerance)
    rows = []
    for name, r in records.items():
        mean, median = 1e3 * float(np.mean(r.seconds)), 1e3 * float(np.median(r.seconds))
        iterations = float(np.mean(r.iterations))
        rows.append(row(model, f"mean frame while dragging, {name}", mean, "ms"))
        rows.append(row(model, f"median frame while dragging, {name}", median, "ms"))
        rows.append(row(model, f"iterations a frame while dragging, {name}", iterations))
        rows.append(row(model, f"farthest vertex from ours, {name}", 1e3 * r.apart, "mm"))
    rows.append(row(model, f"factors made in the {count} frames, {OURS}", factorisations))
    ours = float(np.sum(records[OURS].seconds))
    for name, goal in GOALS.items():
        rows.append(row(model, f"{name} over ldsim, mean frame", float(np.sum(records[name].seconds)) / ours, "", goal))
    return rows
