"""Full-space stepping, dynamic or quasi-static, by L-BFGS or Newton with clamped Hessians.

L-BFGS keeps its preconditioner, the inverse of a Hessian, until a new one pays: every iteration beyond those of the
first step after a factorisation is excess; once the excess adds up to the cost of a factorisation, a new one is made.
Costs are counted in iterations, not seconds, so a run repeats exactly. Newton is the same loop with no memory and a new
Hessian in every iteration.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.full.linear_choice import LinearChoice, choose
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.potential import IncrementalPotential
from ldsim.dynamics.full.preconditioner import TurnedHessian
from ldsim.errors import SolverError
from ldsim.mechanics.elastic import smallest_volume_ratio
from ldsim.mechanics.motion import Conditions, Grab, GrabTracker
from ldsim.mechanics.scene import Scene
from ldsim.optimise.minimiser import minimise
from ldsim.optimise.solution import Reason, Solution

Array = NDArray[np.float64]

STILL = Conditions()
DEFAULTS = FullOptions()
WINDOW = 8


@dataclass(frozen=True, eq=False)
class FullState:
    """All that the next step depends on, so that a resumed run repeats an undisturbed one.

    Attributes:
        u, u_previous: displacements of the last two frames, (n, 3) float64, metres.
        u_factor: the displacement at which the preconditioner is factorised, (n, 3) float64, metres.
        fresh_iterations: iterations of the first step after that; −1 before it was taken.
        excess: iterations beyond those, summed over the steps since.
    """

    u: Array
    u_previous: Array
    u_factor: Array
    fresh_iterations: int = -1
    excess: int = 0

    @classmethod
    def at_rest(cls, n_vertices: int) -> FullState:
        return cls(np.zeros((n_vertices, 3)), np.zeros((n_vertices, 3)), np.zeros((n_vertices, 3)))


class FullStepper:
    """Steps a scene in the full space.

    Args:
        choice: how its sparse systems are solved, where that was chosen before; else as `options.linear_solver` says.
    """

    def __init__(self, scene: Scene, options: FullOptions = DEFAULTS, choice: LinearChoice | None = None) -> None:
        self._scene = scene
        self._options = options
        self._newton = options.method == "newton"
        self.choice = choice or choose(scene, options.linear_solver)
        exact = self._newton or options.quasistatic
        self._hessian = TurnedHessian(scene, self.choice, exact=exact, inertia=not options.quasistatic)
        self._factorised_at: Array | None = None
        self.factorisations = 0

    def step(
        self, state: FullState, grabs: Sequence[Grab], conditions: Conditions = STILL
    ) -> tuple[FullState, Solution]:
        """Advance by one time step; the returned state is new, the given one unchanged."""
        u_factor, fresh, excess = state.u_factor, state.fresh_iterations, state.excess
        if excess > self._options.factor_cost:
            u_factor, fresh, excess = state.u, -1, 0
        predictor = None if self._options.quasistatic else 2 * state.u - state.u_previous
        potential = IncrementalPotential(self._scene, predictor, grabs, conditions.gravity)
        x, guesses = _initial_guess(potential, state, self._scene.pinned, conditions.prescribed)
        if self._newton:
            u_factor = x.reshape(-1, 3).copy()
        self._prepare(u_factor, x, grabs)

        def refactorise(trial: Array, iteration: int) -> bool:
            nonlocal u_factor, fresh
            if iteration == 0 or (iteration % self._options.factor_cost and not self._newton):
                return False
            u_factor, fresh = trial.reshape(-1, 3).copy(), -1
            self._prepare(u_factor, trial, grabs)
            return True

        solution = minimise(
            potential.value_gradient,
            x,
            self._hessian.solve,
            self._options.tolerance,
            window=0 if self._newton else WINDOW,
            max_iterations=self._options.max_iterations,
            refresh=refactorise,
        )
        if fresh < 0:
            fresh, excess = solution.iterations, 0
        else:
            excess += max(solution.iterations - fresh, 0)
        advanced = FullState(x.reshape(-1, 3), state.u, u_factor, fresh, excess)
        return advanced, solution._replace(evaluations=solution.evaluations + guesses)

    def worst_cell(self, state: FullState) -> str:
        """The most inverted cell of a state and what may help, in words."""
        point, J = smallest_volume_ratio(self._scene.elements, state.u)
        cell = int(self._scene.points.cells[point])
        centre = self._scene.mesh.vertices[self._scene.mesh.cells[cell]].mean(axis=0)
        return (
            f"cell {cell}, at rest around {np.round(centre, 4).tolist()} m, is inverted (det F = {J:.3g}); use a "
            "smaller time step, a weaker grab, a slower path, or a material that stays finite (stable_neo_hookean, "
            "fixed_corotated)"
        )

    def set_scene(self, scene: Scene) -> None:
        """Step the same solid under another gravity or with another material from now on (`Scene.changed`)."""
        if not (np.array_equal(scene.mu, self._scene.mu) and np.array_equal(scene.lam, self._scene.lam)):
            self._factorised_at = None
        self._scene = scene
        self._hessian.set_scene(scene)

    def _prepare(self, u_factor: Array, x: Array, grabs: Sequence[Grab]) -> None:
        if self._factorised_at is None or not np.array_equal(u_factor, self._factorised_at):
            self._hessian.factorise(u_factor)
            self._factorised_at = u_factor.copy()
            self.factorisations += 1
        self._hessian.prepare(x.reshape(-1, 3), grabs)


def _initial_guess(
    potential: IncrementalPotential, state: FullState, pinned: NDArray[np.bool_], prescribed: Array | None
) -> tuple[Array, int]:
    """The better of 2uₙ − uₙ₋₁ and uₙ with the pins in place, (3n,), and the number of evaluations it took to tell."""
    moving, still = (2 * state.u - state.u_previous).ravel(), state.u.ravel().copy()
    if prescribed is not None:
        moving.reshape(-1, 3)[pinned] = prescribed
        still.reshape(-1, 3)[pinned] = prescribed
    scratch = np.empty_like(moving)
    if potential.value_gradient(moving, scratch) <= potential.value_gradient(still, scratch):
        return moving, 2
    return still, 2


def run(
    stepper: FullStepper, tracker: GrabTracker, state: FullState, frames: range
) -> Iterator[tuple[int, FullState, Solution]]:
    """Step through the frames of a motion; yields each frame with its state and the solver's record.

    Raises:
        SolverError: a step can only start from a state of infinite energy, because a cell is inverted.
    """
    for frame in frames:
        state, solution = stepper.step(state, tracker.grabs(frame, state.u), tracker.conditions(frame))
        if solution.reason == Reason.INFINITE_START or not np.isfinite(state.u).all():
            raise SolverError(f"frame {frame}: {solution.reason.words}; {stepper.worst_cell(state)}")
        yield frame, state, solution
