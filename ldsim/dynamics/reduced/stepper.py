"""Steps in a reduced space: what they read of it, made once, and one call into compiled code a step."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.dynamics.reduced.advance import advance, beside, step_reference, warp
from ldsim.dynamics.reduced.in_series import InSeries
from ldsim.dynamics.reduced.matrices import diagonal_or_whole, leading, reduced_mass, reduced_rest_stiffness
from ldsim.dynamics.reduced.minimiser import Method, Minimisation
from ldsim.dynamics.reduced.moving_pins import MovingPins
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work, make_work, rounding
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.workspace import Unloaded, Workspace, same_arrays
from ldsim.errors import MotionError
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.pins import MovedPins
from ldsim.optimise.solution import Reason, Solution
from ldsim.space.modes import following
from ldsim.space.space import Space

# Iterations, beyond those of the step that made it, for which a preconditioner is kept, and after which a single step
# gives it up. For L-BFGS what making it anew costs; BFGS mends its own, so that is hardly ever worth it: with 30 in the
# place of 1,000, steps of a linear space of 60 columns were longer on average, and each eighth was long.
RENEWAL_COST = {Method.LBFGS: 6, Method.BFGS: 1000, Method.NEWTON: 0}
RENEWAL = {Method.LBFGS: 12, Method.BFGS: 25, Method.NEWTON: 1}
REASONS = {int(reason): reason for reason in Reason}


class ReducedStepper:
    """Steps a scene in the space u = U φ(z) + L a with a weighted few quadrature points.

    It keeps nothing of a run: what a step depends on is in the state and the loads, so runs and threads may share it.
    What it keeps for each thread is scratch memory, and the springs of the last grabs, for the next step has the same.

    Attributes:
        mass: M̃ = UᵀMU, (k, k) float64, kg in the coordinates of U.
        inertia: M̃/h², or its diagonal, (1, k), where that is all; of modes that swing all of it.
    """

    def __init__(self, space: Space, options: ReducedOptions = ReducedOptions()) -> None:
        space = space.by_material()
        scene, basis, rule = space.scene, space.reduced_basis, space.rule
        self.space, self.scene, self.options = space, scene, options
        self._compliance = space.compliance  # of the solid that is not stiffened
        self._elements = elements = rule.elements(scene)
        self.mass = reduced_mass(scene, basis)
        self._rate = (0.0 if options.quasistatic else 1.0) / scene.time_step**2
        inertia = (0.0 if options.quasistatic else 1.0) * self.mass / scene.time_step**2
        self._stiffness = reduced_rest_stiffness(scene, basis)
        self._model = Reduced(
            space.decoder.layers,
            leading(rule.strain_maps(scene, basis.matrix)),
            np.ascontiguousarray(rule.weights, dtype=np.float64),
            elements.kind,
            elements.mu,
            elements.lam,
            diagonal_or_whole(inertia),
            inertia + self._stiffness if options.inertia else self._stiffness,
            basis.matrix.T @ scene.external_force.ravel(),
            np.zeros((0, 9)),
            space.squares,
            *following(space.squares, self._rate),
        )
        self._own_metric, self._own_force, self.inertia = self._model.metric, self._model.force, self._model.inertia
        self._model = self._swinging(1.0)
        # gravity enters linearly: f̃ = Uᵀ(load + Σ_i g_i m ⊗ e_i)
        self._load = basis.matrix.T @ scene.force(np.zeros(3)).ravel()
        self._weight = np.einsum("nik,n->ki", basis.fields, scene.vertex_mass)
        self._pins = (
            MovingPins.of(space, options.quasistatic) if space.lifting is not None and space.lifting.count else None
        )
        if space.compliance is not None:
            space.compliance.sag()  # factorises now, not in the step that first grabs
        self._dimensions = (space.decoder.r, space.decoder.k)
        method = Method[options.method.upper()]
        self._renewal_cost = RENEWAL_COST[method]
        renewal = RENEWAL[method] if options.current else options.max_iterations
        self._minimisation = Minimisation(
            self._stop(),
            options.max_iterations,
            int(method),
            options.current,
            renewal,
            options.extrapolate,
            options.wolfe,
        )
        self._total_mass = float(scene.mass.sum())
        self._threads = threading.local()

    def _stop(self) -> float:
        """Where a step of the model stops, N."""
        stop = self.options.stop(float(self.scene.vertex_mass.sum()))
        return max(stop, rounding(self._model))  # what is below is never reached

    def _swinging(self, scale: float) -> Reduced:
        """The model with the modes that swing of a solid so many times as stiff."""
        squares = scale * self.space.squares
        follows, gives = following(squares, self._rate)
        inertia, force = self.inertia.copy(), self._own_force.copy()
        if len(squares):
            inertia[:, -len(squares) :] *= follows  # nothing couples modes with other columns, or with each other
            force[-len(squares) :] *= follows
        return self._model._replace(inertia=inertia, force=force, squares=squares, follows=follows, gives=gives)

    def rest(self) -> ReducedState:
        """The undeformed solid, without velocity."""
        r, k = self._dimensions
        return ReducedState.moving(np.zeros(r), np.zeros(r), np.zeros(k), np.zeros(k))

    def state(
        self,
        u: NDArray[np.floating],
        u_previous: NDArray[np.floating],
        pins: tuple[Sequence[MovedPins], Sequence[MovedPins]] = ((), ()),
    ) -> ReducedState:
        """The state nearest to two frames of the full space, the last and the one before, (n, 3) metres each.

        Args:
            pins: where moved pins were in them.
        """
        frames = [np.asarray(u, dtype=np.float64), np.asarray(u_previous, dtype=np.float64)]
        a: tuple[Array | None, Array | None] = (None, None)
        if self._pins is not None:
            a = self._pins.lifting.at(pins[0]), self._pins.lifting.at(pins[1])
            frames = [f - self._pins.lifting.field(b) for f, b in zip(frames, a, strict=True) if b is not None]
        z, q = self.space.encode(np.stack(frames))
        if self.space.is_condensed:
            # as a run has it: what weight and grabs move beside the coordinates is in the frames, but has no inertia
            swinging = q.shape[1] - len(self.space.squares)
            q[:, :swinging] = self.space.decoder(z)[:, :swinging]
        state = ReducedState.moving(z[0], z[1], q[0], q[1])
        state.a, state.a_previous = a
        return state

    def step(self, state: ReducedState, loads: Loads) -> tuple[ReducedState, Solution]:
        """Advance by one time step; the returned state is new, the given one unchanged.

        Raises:
            ValueError: the state is of another model, which the compiled loops would not notice.
            MotionError: the loads move pins that the space was not prepared for, or hold vertices beyond the mesh.
        """
        if state.r != self._dimensions[0] or state.k != self._dimensions[1]:
            raise ValueError(f"the state has (r, k) = {(state.r, state.k)}; this stepper has {self._dimensions}")
        workspace = self._workspace()
        workspace.grab(loads.grabs, loads.gravity)
        force = self._base_force(loads.gravity, workspace)
        pins: tuple[Array | None, Array | None] = (None, None)
        if self._pins is not None:
            pins = self._pins.coordinates(loads), state.a
            self._pins.move(pins[0], state, force, workspace, loads.grabs)
        elif loads.pins:
            raise MotionError(
                f"{len(loads.pins[0].vertices)} pins move; the {self.space.name} space has no lifting for them"
            )
        held = workspace.held
        renew = self.options.every_step or not state.usable or state.excess > self._renewal_cost
        others = not same_arrays(held, state.held)
        data = np.empty(state.room(len(held)))
        iterations, evaluations, reason, value, norm = advance(workspace.reference, state.data, renew, others, data)
        solution = Solution(value, norm, iterations, evaluations, REASONS[reason])
        if renew:  # where no iteration was needed, nothing was made, so the next step must
            kept = (iterations > 0, held, iterations, 0)
        else:
            fresh = state.fresh_iterations
            kept = (iterations > 0 or not others, held, fresh, state.excess + max(iterations - fresh, 0))
        return ReducedState(data, self._dimensions, kept, pins, loads), solution

    def displacement(self, state: ReducedState) -> Array:
        """u = U q + L a, (n, 3) float64, metres."""
        u = self.space.displacement(state.q)
        if self.space.is_condensed:
            u += self.residual(state.q, state.loads)
        return u if self._pins is None or state.a is None else u + self._pins.fields @ state.a

    def residual(self, q: Array, loads: Loads) -> Array:
        """What gravity and grabs move beside the coordinates of a condensed space, (n, 3) metres; zero elsewhere."""
        compliance = self.space.compliance
        if compliance is None:
            return np.zeros_like(self.scene.mesh.vertices)
        u = compliance.sag(loads.gravity, local=True).copy()
        if not loads.grabs:
            return u
        for grab, (amounts, A) in zip(loads.grabs, self._pulling(q, loads), strict=True):
            u += compliance.fields(grab.vertices) @ amounts @ A.T
        if compliance.modes is not None and compliance.modes.turns:  # they have so much of it as they have moved
            F = compliance.modes.fields.reshape(-1, len(compliance.modes.squares))
            u -= (F @ self._workspace().series.given).reshape(u.shape)
        return u

    def pulls(self, state: ReducedState) -> Array:
        """What the grabs of the step that led to a state of a condensed space pull with there, (g, 3) N."""
        if not state.loads.grabs:
            return np.zeros((0, 3))
        self._pulling(state.q, state.loads)
        return self._workspace().series.forces.reshape(-1, 3).copy()

    def _pulling(self, q: Array, loads: Loads) -> list[tuple[Array, Array]]:
        """Of each grab of a condensed space `Dent.amounts`, and its warp A, (3, 3)."""
        workspace = self._workspace()
        workspace.grab(loads.grabs, loads.gravity)
        self._base_force(loads.gravity, workspace)
        warp(workspace.reference, q)
        compliance, series = self.space.compliance, workspace.series
        assert compliance is not None
        laws = [compliance.dent(grab.vertices) for grab in loads.grabs]
        pulls = zip(laws, series.forces.reshape(-1, 3), series.warps, series.coupled, strict=True)
        return [(law.amounts(force @ A, coupled), A) for law, force, A, coupled in pulls]

    def _beside(self, state: ReducedState) -> float:
        """The most that gravity and grabs can move beside the coordinates, in the mass norm."""
        workspace, loads = self._workspace(), state.loads
        sag = workspace.sag(loads.gravity)
        if not loads.grabs:
            return sag
        workspace.grab(loads.grabs, loads.gravity)
        self._base_force(loads.gravity, workspace)
        return sag + float(beside(workspace.reference, state.q, workspace.dents(), np.empty(9)))

    def coordinates(self, state: ReducedState) -> Array:
        """q and beside it where the pins are, a: (k + l,) float64, the coordinates of `Space.fields`."""
        if self._pins is None:
            return state.q
        return np.concatenate([state.q, np.zeros(self._pins.fields.shape[2]) if state.a is None else state.a])

    def within(self, state: ReducedState, limit: float) -> bool:
        """Whether the mass-weighted root mean square of the displacement, pins apart, is at most so many metres."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self._bound(state) <= limit or (self.space.is_condensed and self._extent(state) <= limit)

    def _bound(self, state: ReducedState) -> float:
        """That mean, or of a condensed solid the most that it can be, which costs less, metres."""
        own = float(np.sqrt(state.q @ self.mass @ state.q))
        return (own + (self._beside(state) if self.space.is_condensed else 0.0)) / math.sqrt(self._total_mass)

    def _extent(self, state: ReducedState) -> float:
        """That mean, from every vertex, metres."""
        u = self.space.displacement(state.q) + self.residual(state.q, state.loads)
        return float(np.sqrt(np.vdot(u, self.scene.mass @ u) / self._total_mass))

    def stiffened(self, scale: float) -> ReducedStepper:
        """The same steps with the Lamé parameters of the scene, and the rest stiffness, times a positive number."""
        other = copy(self)
        elements = self._elements
        metric = self._own_metric + (scale - 1) * self._stiffness
        model = self._swinging(scale)
        other._model = model._replace(mu=scale * elements.mu, lam=scale * elements.lam, metric=metric)
        other._minimisation = self._minimisation._replace(tolerance=other._stop())
        if self._compliance is not None:
            other.space = replace(self.space, compliance=self._compliance.stiffened(scale))
        other._threads = threading.local()
        return other

    def compiled(self, loads: Loads = Loads()) -> tuple[Reduced, Springs, Work]:
        """What the kernels of `reduced.potential` read under some loads: model, springs, scratch memory."""
        workspace = self._workspace()
        workspace.grab(loads.grabs, loads.gravity)
        self._base_force(loads.gravity, workspace)
        warp(workspace.reference, np.zeros(self._dimensions[1]))
        return workspace.model, workspace.springs, workspace.work

    def unloaded(self, grabs: int) -> Unloaded:
        """What a thread steps by that writes forces, moduli and so many springs itself; nobody else has its arrays."""
        own, k = self._model, self._dimensions[1]
        lifted = np.zeros((0 if self._pins is None else len(own.weights), 9))
        names = "force", "mu", "lam", "inertia", "squares", "follows", "gives"
        model = own._replace(lifted=lifted, **{name: getattr(own, name).copy() for name in names})
        springs = Springs(np.zeros((grabs, 3, k)), np.zeros((grabs, 3)), np.zeros((grabs, 3)), np.zeros(grabs))
        work = make_work(self.space.decoder, len(own.weights))
        series = InSeries.none(k, len(own.squares))
        return Unloaded(model, springs, step_reference(model, springs, self._minimisation, work, series))

    def _base_force(self, gravity: Array | None, workspace: Workspace) -> Array:
        """Uᵀ f_ext under some gravity, (k,), written into this thread's model where it is not there yet."""
        if gravity is None and not workspace.other_gravity:
            return self._model.force
        workspace.other_gravity = gravity is not None
        force = self._model.force if gravity is None else self._load + self._weight @ gravity
        if gravity is not None and (modes := len(self._model.squares)):
            force[-modes:] *= self._model.follows
        workspace.model.force[:] = force
        return force

    def _workspace(self) -> Workspace:
        """The scratch memory of this thread."""
        found: Workspace | None = getattr(self._threads, "workspace", None)
        if found is None:
            lifted = np.zeros((0 if self._pins is None else len(self._model.weights), 9))
            model = self._model._replace(force=self._model.force.copy(), lifted=lifted)
            found = self._threads.workspace = Workspace(model, self._minimisation, self.space)
        return found
