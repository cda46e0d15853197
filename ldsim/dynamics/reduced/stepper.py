"""From a scene, a basis, a decoder and cubature points to a reduced model, its state and its steps."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.rule import CubatureRule, strain_maps
from ldsim.dynamics.reduced.advance import Reference, advance, step_reference
from ldsim.dynamics.reduced.minimiser import Method, Options
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work, make_work
from ldsim.mechanics.motion import Grab
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.optimise.solution import Reason, Solution
from ldsim.space.decoder import Decoder
from ldsim.space.lifting import Lifting

Array = NDArray[np.float64]

# Iterations that making the current tangent costs, and after which a step gives its preconditioner up. BFGS mends its
# preconditioner by itself.
RENEWAL_COST = {Method.LBFGS: 6, Method.BFGS: 30, Method.NEWTON: 0}
REASONS = {int(reason): reason for reason in Reason}
RENEWAL = {Method.LBFGS: 12, Method.BFGS: 25, Method.NEWTON: 1}


def reduced_mass(scene: Scene, U: Array) -> Array:
    """M̃ = UᵀMU, (k, k) float64."""
    fields = U.reshape(scene.mesh.n_vertices, -1)
    product = np.ascontiguousarray(scene.mass @ fields).reshape(U.shape)
    mass: Array = U.T @ product
    return mass


def reduced_rest_stiffness(scene: Scene, U: Array) -> Array:
    """K̃₀ = UᵀK₀U, (k, k) float64, N/m in the coordinates of U."""
    pattern = StiffnessPattern(scene.points.nodes, scene.free, scene.mesh.n_vertices)
    rest = np.zeros((scene.mesh.n_vertices, 3))
    matrix = pattern.matrix(pattern.stiffness_blocks(scene.elements, rest, clamp=False))
    free = U.reshape(scene.mesh.n_vertices, 3, -1)[scene.free].reshape(3 * pattern.n_free, -1)
    stiffness: Array = free.T @ (matrix @ free)
    return 0.5 * (stiffness + stiffness.T)


class ReducedState:
    """All that the next step depends on; a step makes a new one and leaves the old one as it is.

    Args:
        data: z, z_previous, guess, q, q_previous and H one after the other, (3r + 2k + r²,) float64: each array that
            crosses into compiled code takes time.

    Attributes:
        z, z_previous: latent coordinates of the last two frames, (r,) float64.
        guess: where to start the next step, (r,) float64.
        q, q_previous: outer coordinates of the last two frames, (k,) float64. They need not be φ(z): a state taken from
            the full space keeps the projection of its displacement.
        H: the preconditioner, an estimate of the inverse Hessian, (r, r) float64.
        usable: whether H was made; otherwise the next step makes it.
        held: the vertices of the grabs that it includes.
        fresh_iterations: iterations of the step that made it; excess: iterations beyond those since.
    """

    __slots__ = ("data", "excess", "fresh_iterations", "held", "k", "r", "usable")

    def __init__(
        self,
        data: Array,
        r: int,
        k: int,
        usable: bool = False,
        held: tuple[NDArray[np.int64], ...] = (),
        fresh_iterations: int = 0,
        excess: int = 0,
    ) -> None:
        self.data, self.r, self.k = data, r, k
        self.usable, self.held = usable, held
        self.fresh_iterations, self.excess = fresh_iterations, excess

    @classmethod
    def at_rest(cls, decoder: Decoder) -> ReducedState:
        return cls.moving(np.zeros(decoder.r), np.zeros(decoder.r), np.zeros(decoder.k), np.zeros(decoder.k))

    @classmethod
    def moving(cls, z: Array, z_previous: Array, q: Array, q_previous: Array) -> ReducedState:
        """The state of two frames, with nothing known of what came before."""
        r = len(z)
        parts = (z, z_previous, 2 * z - z_previous, q, q_previous, np.eye(r).ravel())
        return cls(np.concatenate(parts), r, len(q))

    def renewed(self) -> ReducedState:
        """The same, but the next step makes its preconditioner anew."""
        state = ReducedState(self.data.copy(), self.r, self.k)
        state.H[:] = np.eye(self.r)
        return state

    @property
    def z(self) -> Array:
        return self.data[: self.r]

    @property
    def z_previous(self) -> Array:
        return self.data[self.r : 2 * self.r]

    @property
    def guess(self) -> Array:
        return self.data[2 * self.r : 3 * self.r]

    @property
    def q(self) -> Array:
        return self.data[3 * self.r : 3 * self.r + self.k]

    @property
    def q_previous(self) -> Array:
        return self.data[3 * self.r + self.k : 3 * self.r + 2 * self.k]

    @property
    def H(self) -> Array:
        return self.data[3 * self.r + 2 * self.k :].reshape(self.r, self.r)


class Prescribed(NamedTuple):
    """Where moving pins are in one frame: a and its second difference aₙ₊₁ − 2aₙ + aₙ₋₁, (l,) each."""

    a: Array
    change: Array

    @classmethod
    def of(cls, coordinates: Array, frame: int) -> Prescribed:
        """From a in every frame, (N, l); before the first all pins are at rest."""
        rest = np.zeros(coordinates.shape[1])
        a, before, earlier = (coordinates[i] if i >= 0 else rest for i in (frame, frame - 1, frame - 2))
        return cls(a, a - 2 * before + earlier)


class ReducedStepper:
    """Steps a scene in the space u = U φ(z) + L a with a weighted few quadrature points.

    Args:
        cubature: the points, on the mesh or virtual; `CubatureRule.every(scene)` for all.
        method, current: the minimiser (`dynamics.reduced.Options`).
        inertia_in_metric: false for the paper's Eq. 15, JᵀK̃₀J.
        lifting: the pins that may move, L; None where all stand still.

    Attributes:
        mass: M̃ = UᵀMU, (k, k) float64, kg in the coordinates of U.
    """

    def __init__(
        self,
        scene: Scene,
        U: Array,
        decoder: Decoder,
        cubature: CubatureRule,
        *,
        tolerance: float = 1e-8,
        max_iterations: int = 500,
        method: Method = Method.BFGS,
        current: bool = True,
        inertia_in_metric: bool = True,
        lifting: Lifting | None = None,
    ) -> None:
        elements, points = scene.elements, cubature.points
        self.decoder = decoder
        self._vertices = scene.mesh.vertices
        self._U = U.reshape(scene.mesh.n_vertices, 3, -1)
        self.mass = reduced_mass(scene, U)
        inertia = self.mass / scene.time_step**2
        stiffness = reduced_rest_stiffness(scene, U)
        self._model = Reduced(
            decoder.layers,
            cubature.strain_maps(scene, U),
            np.ascontiguousarray(cubature.weights, dtype=np.float64),
            elements.kind[points],
            elements.mu[points],
            elements.lam[points],
            _diagonal(inertia),
            inertia + stiffness if inertia_in_metric else stiffness,
            U.T @ scene.external_force.ravel(),
            np.zeros((0 if lifting is None or lifting.count == 0 else len(points), 9)),
        )
        self.lifting = lifting
        self._moving = len(self._model.lifted) > 0
        if lifting is not None and lifting.count:
            self._lift(scene, U, lifting.fields, points)
        self._base, self._stiffness = self._model, stiffness
        # gravity enters linearly: f̃ = Uᵀ(load + Σ_i g_i m ⊗ e_i)
        self._own_force = self._model.force.copy()
        self._load = U.T @ scene.force(np.zeros(3)).ravel()
        self._weight = np.einsum("nik,n->ki", self._U, scene.vertex_mass)
        self._gravity: Array | None = None
        self._dimensions = (decoder.r, decoder.k)
        self._renewal_cost = RENEWAL_COST[method]
        renewal = RENEWAL[method] if current else max_iterations
        self._options = Options(tolerance, max_iterations, int(method), current, renewal)
        self._work = make_work(decoder, len(points))
        self._springs_of: tuple[NDArray[np.int64], ...] = ()
        self._springs = self._make_springs([])
        self._reference = self._make_reference()

    def twin(self) -> ReducedStepper:
        """A stepper of the same model with memory of its own, for another thread."""
        other = copy(self)
        other._model = self._model._replace(force=self._model.force.copy(), lifted=self._model.lifted.copy())
        other._work = make_work(self.decoder, len(self._model.weights))
        other._springs_of, other._springs = (), self._make_springs([])
        other._reference = other._make_reference()
        return other

    @property
    def compiled(self) -> tuple[Reduced, Springs, Work]:
        """What the kernels of `reduced_potential` read: the model, the springs of the last step, scratch memory."""
        return self._model, self._springs, self._work

    def _lift(self, scene: Scene, U: Array, fields: Array, points: NDArray[np.int64]) -> None:
        """What the steps need of L: its strain at the points, (c, 9, l), UᵀML/h², (k, l), and itself by vertex."""
        self._lifted_strain = strain_maps(scene, fields, points)
        momentum = np.asarray(scene.mass @ fields.reshape(scene.mesh.n_vertices, -1)).reshape(fields.shape)
        self._lifted_inertia = U.T @ momentum / scene.time_step**2
        self._fields = fields.reshape(scene.mesh.n_vertices, 3, -1)

    def step(
        self,
        state: ReducedState,
        grabs: Sequence[Grab],
        gravity: Array | None = None,
        prescribed: Prescribed | None = None,
    ) -> tuple[ReducedState, Solution]:
        """Advance by one time step; the returned state is new, the given one unchanged.

        Args:
            gravity: (3,) float64, m/s²; None for the scene's own.
            prescribed: where the pins are; None where all stand still.

        Raises:
            ValueError: the state is of another model, which the compiled loops would not notice.
        """
        if state.r != self._dimensions[0] or state.k != self._dimensions[1]:
            raise ValueError(f"the state has (r, k) = {(state.r, state.k)}; this stepper has {self._dimensions}")
        if gravity is not None or self._gravity is not None:
            self._set_gravity(gravity)
        self.springs(grabs)
        held = self._springs_of
        renew = not state.usable or state.excess > self._renewal_cost or not _same(held, state.held)
        if self._moving:
            self._set_pins(prescribed, grabs)
        data = np.empty(len(state.data))
        iterations, evaluations, reason, value, norm = advance(self._reference, state.data, renew, data)
        solution = Solution(value, norm, iterations, evaluations, REASONS[reason])
        if renew:  # where no iteration was needed, nothing was factorised, so the next step must
            return ReducedState(data, state.r, state.k, iterations > 0, held, iterations), solution
        fresh = state.fresh_iterations
        excess = state.excess + max(iterations - fresh, 0)
        return ReducedState(data, state.r, state.k, True, held, fresh, excess), solution

    def _set_gravity(self, gravity: Array | None) -> None:
        self._gravity = gravity
        self._model.force[:] = self._own_force if gravity is None else self._load + self._weight @ gravity

    def _set_pins(self, prescribed: Prescribed | None, grabs: Sequence[Grab]) -> None:
        a, change = prescribed or (np.zeros(self._fields.shape[2]),) * 2
        force = self._own_force if self._gravity is None else self._load + self._weight @ self._gravity
        self._model.force[:] = force - self._lifted_inertia @ change
        self._model.lifted[:] = self._lifted_strain @ a
        for i, grab in enumerate(grabs):
            rest = self._vertices[grab.vertices].mean(axis=0)
            self._springs.centre[i] = rest + self._fields[grab.vertices].mean(axis=0) @ a

    def set_material_scale(self, scale: float) -> None:
        """Multiply the Lamé parameters that the model was built with, and the rest stiffness, by a positive number."""
        base = self._base
        metric = base.metric + (scale - 1) * self._stiffness
        self._model = self._model._replace(mu=scale * base.mu, lam=scale * base.lam, metric=metric)
        self._reference = self._make_reference()

    def springs(self, grabs: Sequence[Grab]) -> Springs:
        """The grabs in reduced coordinates; B is kept while the same vertices are held."""
        held = [grab.vertices for grab in grabs]
        if not _same(held, self._springs_of):
            self._springs = self._make_springs(grabs)
            self._springs_of = tuple(held)
            self._reference = self._make_reference()
        _, _, target, stiffness = self._springs
        for i, grab in enumerate(grabs):
            target[i] = grab.target
            stiffness[i] = grab.stiffness
        return self._springs

    def _make_reference(self) -> Reference:
        return step_reference(self._model, self._springs, self._options, self._work)

    def _make_springs(self, grabs: Sequence[Grab]) -> Springs:
        count, k = len(grabs), self._U.shape[2]
        springs = Springs(np.zeros((count, 3, k)), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count))
        for i, grab in enumerate(grabs):
            springs.B[i] = self._U[grab.vertices].mean(axis=0)
            springs.centre[i] = self._vertices[grab.vertices].mean(axis=0)
        return springs

    def displacement(self, state: ReducedState, prescribed: Prescribed | None = None) -> Array:
        """u = U q + L a, (n, 3) float64, metres."""
        u: Array = self._U @ state.q
        return u if prescribed is None or not self._moving else u + self._fields @ prescribed.a


def _same(left: Sequence[NDArray[np.int64]], right: Sequence[NDArray[np.int64]]) -> bool:
    """Whether both hold the same arrays, which a drag keeps from frame to frame."""
    if left is right:
        return True
    if len(left) != len(right):
        return False
    for i, vertices in enumerate(left):
        if vertices is not right[i]:
            return False
    return True


def _diagonal(matrix: Array) -> Array:
    """The diagonal (1, k) of a matrix with nothing else but rounding, or the matrix."""
    diagonal = np.diagonal(matrix)
    rest = np.abs(matrix - np.diag(diagonal)).max()
    return np.ascontiguousarray(diagonal[None]) if rest <= 1e-13 * diagonal.min() else matrix
