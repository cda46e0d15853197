"""The simulator: one solid in one space, grabbed and stepped.

What goes wrong in a step is put right or reported in words, and never costs the state: it stays finite and near the
solid whatever is asked of it.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ldsim.arrays import Array, Indices
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.stepper import Stepper
from ldsim.errors import MotionError, SceneError, SolverError
from ldsim.mechanics.elastic import elastic_energy
from ldsim.mechanics.grabs import Grab, checked_vector, held_vertices, usual_grip
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.motion import Drag
from ldsim.mechanics.pins import MovedPins
from ldsim.mesh.surface import Surface
from ldsim.optimise.solution import Reason, Solution
from ldsim.simulator.checks import checked_grab, checked_pins
from ldsim.simulator.fields import VertexField
from ldsim.simulator.records import Outcome, SavedState, StepRecord
from ldsim.space.space import Space

# A step that leaves the solid this many diagonals (root mean square over its mass) from its rest shape is not taken.
BOUND = 3.0


class Handle:
    """A grab in a simulator, to be moved and let go."""

    def __init__(self, simulator: Simulator, key: int) -> None:
        self._simulator = simulator
        self._key = key

    @property
    def grab(self) -> Grab:
        """What it holds, where to, and how strongly.

        Raises:
            MotionError: it was released, here, by `reset` or by `restore`.
        """
        if self._key not in self._simulator.held:
            raise MotionError("this grab was released; grab again")
        return self._simulator.held[self._key]

    @property
    def vertices(self) -> Indices:
        """The vertices held, (g,) int64."""
        return self.grab.vertices

    @property
    def target(self) -> Array:
        """Where their centroid is pulled to, (3,) float64, metres."""
        return self.grab.target

    @property
    def centroid(self) -> Array:
        """Where the centroid of the vertices held is now, (3,) float64, metres."""
        return self._simulator.centroid(self.vertices)

    @property
    def force(self) -> Array:
        """What it pulls with now, (3,) float64, N."""
        return self._simulator.force(self.grab)

    def move(self, target: ArrayLike) -> None:
        """Pull to another target, (3,) metres."""
        self._simulator.held[self._key] = replace(self.grab, target=checked_vector(target, "target", "m"))

    def on(self, simulator: Simulator) -> Handle:
        """The same grab on a simulator that follows this one's."""
        return Handle(simulator, self._key)

    def release(self) -> None:
        """Let go; a second time does nothing."""
        self._simulator.held.pop(self._key, None)


class Simulator:
    """Steps one solid in one space.

    Args:
        space: its scene, and what it looks like from outside.
        stepper: how its states are stepped.
        bound: a step that leads further than this many diagonals from rest is not taken.

    Attributes:
        held: what is held now, by the number of its handle.
        last: the record of the last step, None before the first.
        counts: how many steps came to each outcome since the last reset.
    """

    __slots__ = (
        "_before", "_gravity", "_limit", "_material_scale", "_next_key", "_number", "_own_stepper", "_pins", "_state",
        "_stepper", "_stress", "counts", "held", "last", "scene", "space", "surface",
    )  # fmt: skip

    def __init__(self, space: Space, stepper: Stepper[Any], bound: float = BOUND) -> None:
        self.space, self.scene = space, space.scene
        self.surface = Surface.of(self.scene.mesh)
        self._own_stepper = self._stepper = stepper
        self._limit = bound * self.scene.mesh.diagonal
        self._gravity: Array | None = None
        self._material_scale = 1.0
        self._next_key = 0
        self._stress: VertexField | None = None
        self.reset()

    def __repr__(self) -> str:
        count = f" of {self.space.r} number{'s' * (self.space.r != 1)}" if self.space.basis is not None else ""
        name = f"{self.space.name} space{count}, {self.scene.mesh.n_vertices:,} vertices"
        grabs = f"{len(self.held)} grab{'s' * (len(self.held) != 1)}"
        return f"<Simulator: {name}, at {self.time:.4g} s with {grabs}>"

    def reset(self) -> None:
        """Back to rest, without grabs; gravity and material stay as they were set."""
        self._state = self._before = self._stepper.rest()
        self.held: dict[int, Grab] = {}
        self._pins: tuple[MovedPins, ...] = ()
        self._number = 0
        self.last: StepRecord | None = None
        self.counts = dict.fromkeys(Outcome, 0)

    def grab(
        self,
        point: ArrayLike,
        target: ArrayLike,
        stiffness: float | None = None,
        radius: float | None = None,
        *,
        at_rest: bool = False,
    ) -> Handle:
        """Take hold of the vertices around a point and pull their centroid towards a target.

        Args:
            point: where, (3,) metres, on the deformed solid, or on the rest shape with `at_rest`.
            target: where to, (3,) metres.
            stiffness: of the spring, N/m; by default a hundredth of shear modulus times diagonal.
            radius: vertices within it of the one nearest to the point are held, metres; by default a tenth of the
                diagonal. 0 holds that vertex alone; to the C library it means the default.

        Raises:
            MotionError: the point is not near the solid, all vertices there are pinned, or a value is not allowed.

        Warns:
            UserWarning: the point itself is pinned, so that only what is beside it gives way.
        """
        usual_stiffness, usual_radius = usual_grip(self.scene)
        stiffness = usual_stiffness if stiffness is None else stiffness
        radius = usual_radius if radius is None else radius
        place = checked_vector(target, "target", "m")
        drag = Drag(self._number, checked_vector(point, "point", "m"), place[None], radius, stiffness, at_rest)
        positions = self.scene.mesh.vertices + (0.0 if at_rest else self.displacement())
        vertices = held_vertices(drag, positions, self.scene.movable, 0.5 * self.scene.mesh.diagonal)
        nearest = int(np.linalg.norm(positions - drag.point, axis=1).argmin())
        if not self.scene.movable[nearest]:
            warnings.warn(
                f"the point {np.round(drag.point, 4).tolist()} is pinned and will not move; what is pulled are the "
                f"{len(vertices)} free vertices within {radius:.3g} m of it. Grab where the solid can give way",
                stacklevel=2,
            )
        grab = checked_grab(Grab(vertices, place, stiffness), self.scene)
        key, self._next_key = self._next_key, self._next_key + 1
        self.held[key] = grab
        return Handle(self, key)

    def set_grabs(self, grabs: Sequence[Grab]) -> None:
        """Hold exactly these from now on, as a motion that is replayed does.

        Raises:
            MotionError: what one holds are not vertices of the solid, each once, or a number is not allowed.
        """
        self.held = dict(enumerate([checked_grab(grab, self.scene) for grab in grabs], self._next_key))
        self._next_key += len(grabs)

    def set_pins(self, pins: Sequence[MovedPins]) -> None:
        """Where moved pins are from now on; all others are at rest. Reset brings all of them back.

        A reduced space moves the pins that a motion of its run moves, and no others.

        Raises:
            MotionError: what moves are not pinned vertices, each once, or a map is none.
        """
        self._pins = checked_pins(pins, self.scene)

    @property
    def grabs(self) -> list[Grab]:
        """What is held now."""
        return [self.held[key] for key in sorted(self.held)]

    @property
    def gravity(self) -> Array:
        """Acceleration, (3,) float64, m/s²; can be set at any time."""
        return (self.scene.gravity if self._gravity is None else self._gravity).astype(np.float64)

    @gravity.setter
    def gravity(self, value: ArrayLike) -> None:
        self._change(checked_vector(value, "gravity", "m/s²"), self._material_scale)

    @property
    def material_scale(self) -> float:
        """What the scene's Lamé parameters are multiplied by; can be set to any positive number at any time.

        Refused where a condensed solid would be so soft that its dead load alone moves it out of bounds.
        """
        return self._material_scale

    @material_scale.setter
    def material_scale(self, value: float) -> None:
        if not 0 < value < np.inf:
            raise SceneError(f"material scale is {value:g}; it must be positive and finite")
        self._change(self._gravity, float(value))

    def _change(self, gravity: Array | None, material_scale: float) -> None:
        self._stepper, self._state = self._scaled(self._state, material_scale)
        self._gravity, self._material_scale = gravity, material_scale

    def _scaled(self, state: Any, material_scale: float) -> tuple[Stepper[Any], Any]:
        """What steps the material so scaled, and the state with it, within bounds."""
        if material_scale == self._material_scale:
            return self._stepper, state
        stepper, state = self._own_stepper.stiffened(material_scale), state.renewed()
        if stepper.within(state, self._limit):
            return stepper, state
        # softer, a condensed solid gives way at once to what pulled it: then rather to nothing
        for other in (state, stepper.rest()):
            other.loads = Loads((), np.zeros(3))
            if stepper.within(other, self._limit):
                return stepper, other
        raise SceneError(
            f"material scale is {material_scale:g}; so soft, the dead load alone moves the solid more than "
            f"{self._limit:.3g} m: it must be larger"
        )

    def step(self, count: int = 1) -> StepRecord:
        """Advance by so many time steps; returns the record of the last.

        Raises:
            ValueError: the count is not positive.
        """
        if count < 1:
            raise ValueError(f"step count is {count}; it must be at least 1")
        for _ in range(count):
            record = self._step()
        return record

    def _step(self) -> StepRecord:
        started = time.perf_counter()
        before = self._state
        self._state, solution, outcome = self._attempt(Loads(tuple(self.grabs), self._gravity, self._pins))
        self._before = before if outcome in (Outcome.SOLVED, Outcome.SHORT) else self._state.standing()
        self._number += 1
        self.counts[outcome] += 1
        self.last = StepRecord(
            self._number,
            time.perf_counter() - started,
            solution.iterations,
            solution.evaluations,
            solution.reason,
            solution.gradient_norm,
            outcome,
        )
        return self.last

    def _attempt(self, loads: Loads) -> tuple[Any, Solution, Outcome]:
        """The next state: in motion, else with what was kept from earlier steps renewed, else from standstill.

        The solution is that of the state returned, but for iterations and evaluations, which are those of all tries.
        """
        state, solution = self._tried(self._state, loads)
        tries, lost = [solution], self._lost(state, solution)
        if solution.reason == Reason.NO_DECREASE and not lost:
            other, second = self._tried(self._state.renewed(), loads)
            tries.append(second)
            if not self._lost(other, second):
                state, solution = other, second
        outcome = Outcome.SOLVED if solution.converged else Outcome.SHORT
        if lost:
            standing = self._state.standing()
            state, solution = self._tried(standing, loads)
            tries.append(solution)
            state, outcome = (standing, Outcome.HELD) if self._lost(state, solution) else (state, Outcome.SLOWED)
        counted = solution._replace(
            iterations=sum(each.iterations for each in tries), evaluations=sum(each.evaluations for each in tries)
        )
        return state, counted, outcome

    def _tried(self, state: Any, loads: Loads) -> tuple[Any, Solution]:
        """A step; one that cannot even be begun, as where no factor can be made, led nowhere."""
        try:
            found: tuple[Any, Solution] = self._stepper.step(state, loads)
        except (SolverError, ArithmeticError, np.linalg.LinAlgError):
            return state, Solution(np.inf, np.inf, 0, 0, Reason.INFINITE_START)
        return found

    def _lost(self, state: Any, solution: Solution) -> bool:
        """Whether a step led nowhere, to a state that is not finite, or out of bounds."""
        if solution.reason == Reason.INFINITE_START:
            return True
        return not self._stepper.within(state, self._limit)

    @property
    def time(self) -> float:
        """Simulated since the last reset, seconds."""
        return self._number * self.scene.time_step

    @property
    def coordinates(self) -> Array:
        """What describes the shape: q in a reduced space, and where its pins are; u (3n,) in the full one; float64."""
        return self._stepper.coordinates(self._state).copy()

    @property
    def novelty(self) -> float:
        """How far the state is from the training data; from 1 on, beware. NaN where the run does not tell."""
        novelty = self.space.novelty
        return np.nan if novelty is None else float(novelty(self._state.z[None])[0]) / novelty.threshold

    def displacement(self, vertices: Indices | slice = slice(None)) -> Array:
        """u of every vertex, or of some (v,); (v, 3) float64, metres."""
        return self._stepper.displacement(self._state)[vertices].copy()

    def velocity(self, vertices: Indices | slice = slice(None)) -> Array:
        """What the displacement changed by in the last step over its time, (v, 3) float64, m/s; 0 at rest."""
        before = self._stepper.displacement(self._before)[vertices]
        return (self.displacement(vertices) - before) / self.scene.time_step

    @property
    def centre_of_mass(self) -> Array:
        """Where it is now, (3,) float64, metres."""
        mass = self.scene.vertex_mass
        centre: Array = mass @ (self.scene.mesh.vertices + self.displacement()) / mass.sum()
        return centre

    @property
    def elastic_energy(self) -> float:
        """What the deformation stores, over all points of the mesh, J."""
        return self._material_scale * float(elastic_energy(self.scene.elements, self.displacement()))

    def stress(self) -> Array:
        """The von Mises stress at every vertex, (n,) float64, Pa: the mean of the points around it, by volume."""
        if self._stress is None:
            self._stress = VertexField(self.scene, np.arange(self.scene.mesh.n_vertices))
        return self._stress("stress", self.displacement(), self._material_scale)

    def follow(self, other: Simulator) -> None:
        """Take over what another simulator of the same solid does: shape, velocity, grabs, pins, gravity and material.

        A reduced space takes the nearest shape that it has; where the other is in the very same space, that is its own.

        Raises:
            SolverError: it is of another solid.
        """
        if other.scene.mesh.n_vertices != self.scene.mesh.n_vertices:
            found, own = other.scene.mesh.n_vertices, self.scene.mesh.n_vertices
            raise SolverError(f"a solid of {found} vertices cannot be followed by one of {own}")
        pins, scale = other._pins, other._material_scale
        if self._in_the_space_of(other):
            # what weight and grabs move beside the coordinates of a condensed space cannot be told from frames
            state, before = other._state, other._before
        else:
            frames = other.displacement(), other._stepper.displacement(other._before)
            state = self._stepper.state(*frames, (pins, pins))
            before = self._stepper.state(frames[1], frames[1], (pins, pins))
        self._stepper, self._state = self._scaled(state, scale)
        self._before, self._pins, self._gravity, self._material_scale = before, pins, other._gravity, scale
        self.held, self._next_key, self._number = dict(other.held), other._next_key, other._number

    def _in_the_space_of(self, other: Simulator) -> bool:
        """Whether its states mean the same here."""
        mine, theirs = self.space, other.space
        if type(self._state) is not type(other._state) or mine.basis is None or theirs.basis is None:
            return False  # of the full space frames tell all
        if mine is theirs:
            return True
        alike = (np.array_equal(own, given) for own, given in zip_longest(_meaning(mine), _meaning(theirs)))
        return mine.is_condensed == theirs.is_condensed and all(alike)

    def centroid(self, vertices: Indices) -> Array:
        """The mean position of some vertices now, (3,) float64, metres."""
        rest: Array = self.scene.mesh.vertices[vertices].mean(axis=0)
        if self.space.basis is None or self.space.is_condensed:
            u: Array = self.displacement()[vertices].mean(axis=0)
        else:
            u = self.space.fields[vertices].mean(axis=0) @ self._stepper.coordinates(self._state)
        return rest + u

    def force(self, grab: Grab) -> Array:
        """What one of the grabs pulls with now, (3,) float64, N."""
        if isinstance(self._stepper, ReducedStepper) and self.space.is_condensed:
            # what is drawn tells no force: dents of several grabs couple
            for then, pull in zip(self._state.loads.grabs, self._stepper.pulls(self._state), strict=True):
                if then.vertices is grab.vertices:
                    return np.asarray(pull + grab.stiffness * (grab.target - then.target))
        return grab.stiffness * (grab.target - self.centroid(grab.vertices))

    def save(self) -> SavedState:
        """The present state, with grabs, gravity and material, to come back to; one can be restored many times."""
        return SavedState(
            self._state, self._before, dict(self.held), self._pins, self._gravity, self._material_scale, self._number
        )

    def restore(self, saved: SavedState) -> None:
        """Continue from a saved state of this run and space.

        Raises:
            SolverError: it is of another kind of space or of other coordinates, is not finite, or is out of bounds.
        """
        if type(saved.state) is not type(self._state):
            raise SolverError(f"the saved state is of another space than {self.space.name}")
        present, given = self.coordinates.shape, self._stepper.coordinates(saved.state).shape
        if present != given:
            raise SolverError(f"the saved state has coordinates {given}; this simulator has {present}")
        stepper, state, scale = self._stepper, saved.state, saved.material_scale
        if scale != self._material_scale:  # how far weight and grabs move a condensed solid goes by its own
            stepper, state = self._own_stepper.stiffened(scale), state.renewed()
        if not stepper.within(saved.state, self._limit):
            raise SolverError(f"the saved state is not finite or more than {self._limit:.3g} m from rest")
        self._stepper, self._state = stepper, state
        self._gravity, self._material_scale = saved.gravity, saved.material_scale
        self.held, self._number = dict(saved.grabs), saved.number
        # another simulator may have saved it: what is grabbed from now on must not take the place of its grabs
        self._next_key = max(self._next_key, 1 + max(saved.grabs, default=-1))
        self._before, self._pins = saved.before, saved.pins


def _meaning(space: Space) -> list[Any]:
    """What a shape is read from the coordinates of a reduced space by."""
    supports = () if space.lifting is None else space.lifting.supports
    return [space.reduced_basis.fields, space.squares, *space.decoder.layers, *supports]
