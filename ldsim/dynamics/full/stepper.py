"""Full-space stepping, dynamic or quasi-static, by L-BFGS or Newton with clamped Hessians.

L-BFGS keeps its preconditioner, the inverse of a Hessian, until a new one pays: every iteration beyond those of the
first step after a factorisation is excess; once the excess adds up to the cost of a factorisation, a new one is made.
Costs are counted in iterations, not seconds, so a run repeats exactly. Newton is the same loop with no memory and a new
Hessian in every iteration.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.dynamics.full.linear_choice import LinearChoice, choose
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.potential import IncrementalPotential, rounding
from ldsim.dynamics.full.preconditioner import WarpedHessian
from ldsim.dynamics.simulate import Frame
from ldsim.errors import LostMotionError
from ldsim.mechanics.elastic import smallest_volume_ratio
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene
from ldsim.optimise.minimiser import minimise
from ldsim.optimise.solution import Solution

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
    def moving(cls, u: Array, u_previous: Array) -> FullState:
        """The state of two frames, with nothing known of what came before."""
        return cls(u, u_previous, u)

    def standing(self) -> FullState:
        """The same shape without velocity and with nothing kept from earlier steps."""
        return FullState.moving(self.u, self.u)

    def renewed(self) -> FullState:
        """The same shape and velocity with nothing else kept from earlier steps."""
        return FullState.moving(self.u, self.u_previous)


class FullStepper:
    """Steps a scene in the full space.

    It keeps nothing of a run. What it keeps for each thread is the last factorisation: a state says where its
    preconditioner is factorised, and where that is the displacement of the last step, nothing is factorised anew.

    Args:
        choice: the linear solver, where one was chosen before; found by the options otherwise.
        seconds: after which a step begins no further iteration, for those who watch; what it leads to then depends on
            the machine.
    """

    def __init__(
        self,
        scene: Scene,
        options: FullOptions = FullOptions(),
        choice: LinearChoice | None = None,
        seconds: float = math.inf,
    ) -> None:
        self.scene, self.options, self.seconds = scene, options, seconds
        self._own_scene = scene
        self.choice = choose(scene, options.linear_solver) if choice is None else choice
        self._newton = options.method == "newton"
        self._total_mass = float(scene.mass.sum())
        self._noise, least = rounding(scene)
        self._tolerance = max(options.stop(scene.vertex_mass), least)  # what is below is never reached
        self._threads = threading.local()

    def rest(self) -> FullState:
        """The undeformed solid, without velocity."""
        zero = np.zeros((self.scene.mesh.n_vertices, 3))
        return FullState.moving(zero, zero)

    def state(
        self,
        u: NDArray[np.floating],
        u_previous: NDArray[np.floating],
        pins: tuple[Sequence[MovedPins], Sequence[MovedPins]] = ((), ()),
    ) -> FullState:
        """The state of two frames, the last and the one before, (n, 3) metres each."""
        return FullState.moving(np.array(u, dtype=np.float64), np.array(u_previous, dtype=np.float64))

    def step(self, state: FullState, loads: Loads) -> tuple[FullState, Solution]:
        """Advance by one time step; the returned state is new, the given one unchanged.

        Raises:
            MotionError: a grab holds vertices beyond the mesh.
        """
        hessian, options, deadline = self._hessian(), self.options, time.perf_counter() + self.seconds
        u_factor, fresh, excess, midway = state.u_factor, state.fresh_iterations, state.excess, False
        if excess > options.factor_cost:
            u_factor, fresh, excess = state.u, -1, 0
        predictor = None if options.quasistatic else 2 * state.u - state.u_previous
        potential = IncrementalPotential(self.scene, predictor, loads.grabs, loads.gravity)
        x, guesses = self._initial_guess(potential, state, loads)
        if self._newton:
            u_factor = x.reshape(-1, 3).copy()
        hessian.factorise(u_factor)
        hessian.prepare(x.reshape(-1, 3), loads.grabs)

        def refactorise(trial: Array, iteration: int) -> bool:
            nonlocal u_factor, midway
            if iteration == 0 or (iteration % options.factor_cost and not self._newton):
                return False
            u_factor, midway = trial.reshape(-1, 3).copy(), True
            hessian.factorise(u_factor)
            hessian.prepare(u_factor, loads.grabs)
            return True

        solution = minimise(
            potential.value_gradient,
            x,
            hessian.solve,
            self._tolerance,
            pairs=0 if self._newton else WINDOW,
            max_iterations=options.max_iterations,
            refresh=refactorise,
            deadline=deadline,
            noise=self._noise,
        )
        if midway:  # this step began with an older factor, so the next one is the first
            fresh, excess = -1, 0
        elif fresh < 0:
            fresh, excess = solution.iterations, 0
        else:
            excess += max(solution.iterations - fresh, 0)
        advanced = FullState(x.reshape(-1, 3), state.u, u_factor, fresh, excess)
        return advanced, solution._replace(evaluations=solution.evaluations + guesses)

    def displacement(self, state: FullState) -> Array:
        """u, (n, 3) float64, metres."""
        return state.u

    def coordinates(self, state: FullState) -> Array:
        """u, (3n,) float64, metres."""
        return state.u.ravel()

    def within(self, state: FullState, limit: float) -> bool:
        """Whether the mass-weighted root mean square of u, beside how far the pins went, is at most so many metres."""
        u = state.u - state.u[self.scene.pinned].mean(axis=0)
        return bool(np.vdot(u, self.scene.mass @ u) <= limit**2 * self._total_mass)

    def stiffened(self, scale: float) -> FullStepper:
        """The same steps with the Lamé parameters of the scene times a positive number."""
        other = FullStepper(self._own_scene.stiffened(scale), self.options, self.choice, self.seconds)
        other._own_scene = self._own_scene
        return other

    @property
    def factorisations(self) -> int:
        """How many were made in this thread."""
        return self._hessian().factorisations

    def gone_wrong(self, state: FullState) -> str:
        """What is wrong with a state, the most inverted cell if there is one, and what may help, in words."""
        point, J = smallest_volume_ratio(self.scene.elements, state.u)
        if J > 0:
            far = np.linalg.norm(state.u - state.u[self.scene.pinned].mean(axis=0), axis=1).max()
            return f"the solid has left its pins by {far:.3g} m; use weaker loads, or a stiffer material"
        cell = int(self.scene.points.cells[point])
        centre = self.scene.mesh.vertices[self.scene.mesh.cells[cell]].mean(axis=0)
        return (
            f"cell {cell}, at rest around {np.round(centre, 4).tolist()} m, is inverted (det F = {J:.3g}); use a "
            "smaller time step, a weaker grab, a slower path, or a material that stays finite (stable_neo_hookean, "
            "fixed_corotated)"
        )

    def _initial_guess(self, potential: IncrementalPotential, state: FullState, loads: Loads) -> tuple[Array, int]:
        """The better of 2uₙ − uₙ₋₁ and uₙ with the pins in place, (3n,), and the evaluations it took to tell."""
        moving, still = (2 * state.u - state.u_previous).ravel(), state.u.ravel().copy()
        pinned = np.zeros_like(state.u)
        for pins in loads.pins:
            pinned[pins.vertices] = pins.displacement(self.scene.mesh.vertices)
        for guess in (moving, still):
            guess.reshape(-1, 3)[self.scene.pinned] = pinned[self.scene.pinned]
        scratch = np.empty_like(moving)
        if potential.value_gradient(moving, scratch) <= potential.value_gradient(still, scratch):
            return moving, 2
        return still, 2

    def _hessian(self) -> WarpedHessian:
        """That of this thread, made at the displacement of the last factorisation."""
        found: WarpedHessian | None = getattr(self._threads, "hessian", None)
        if found is None:
            exact, inertia = self._newton or self.options.quasistatic, not self.options.quasistatic
            found = self._threads.hessian = WarpedHessian(self.scene, self.choice, exact=exact, inertia=inertia)
        return found


def none_lost(stepper: FullStepper, frames: Iterator[Frame[FullState]]) -> Iterator[Frame[FullState]]:
    """The frames of a run.

    Raises:
        LostMotionError: one is lost, mostly because a cell is inverted; naming the frame, and what may help.
    """
    for frame in frames:
        if frame.lost:
            reason = frame.solution.reason.words
            raise LostMotionError(f"frame {frame.number}: {reason}; {stepper.gone_wrong(frame.state)}")
        yield frame
