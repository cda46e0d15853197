"""Reduced motion with every element integrated, so that cubature plays no part in what is measured.

Through the mesh: u = U φ(z), element forces on the vertices, Uᵀf. The reduced step of the package reads k numbers for
each strain of each point, which for all elements is some ten times as much memory in each evaluation.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from ldsim.arrays import Array
from ldsim.dynamics.reduced.matrices import reduced_mass
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.optimise.minimiser import minimise
from ldsim.optimise.solution import Solution
from ldsim.space.space import Space

# Steps that a preconditioner is kept for, and iterations after which it is given up.
KEPT = 6
GIVE_UP = 12
TOLERANCE = 1e-6


class EveryElement:
    """Steps a scene in the space u = U φ(z) by implicit Euler (paper, Eq. 12) with all quadrature points.

    Pins stand still. What it keeps from step to step is its preconditioner, which moves the result by less than the
    tolerance.
    """

    def __init__(self, space: Space) -> None:
        self.space, self.scene, self.decoder = space, space.scene, space.decoder
        basis, scene = space.reduced_basis, space.scene
        self._U, self._fields = basis.matrix, basis.fields
        self._UT = np.ascontiguousarray(self._U.T)
        self.mass = reduced_mass(scene, basis)
        self._inertia = self.mass / scene.time_step**2
        self._load = self._UT @ scene.external_force.ravel()
        self._pattern = StiffnessPattern(scene.points.nodes, scene.free, scene.mesh.n_vertices)
        self._free = np.ascontiguousarray(self._fields[scene.free].reshape(-1, basis.k))
        self._total_mass = float(scene.mass.sum())
        self._stiffness: Array | None = None
        self._age = 0

    def rest(self) -> ReducedState:
        """The undeformed solid, without velocity."""
        z, q = np.zeros(self.decoder.r), np.zeros(self.decoder.k)
        return ReducedState.moving(z, z, q, q)

    def state(self, u: NDArray[np.floating], u_previous: NDArray[np.floating], pins: object = ()) -> ReducedState:
        """The state nearest to two frames of the full space, the last and the one before, (n, 3) metres each."""
        z, q = self.space.encode(np.stack([u, u_previous]))
        return ReducedState.moving(z[0], z[1], q[0], q[1])

    def displacement(self, state: ReducedState) -> Array:
        """u = U q, (n, 3) metres."""
        return self.space.displacement(state.q)

    def coordinates(self, state: ReducedState) -> Array:
        """q, (k,)."""
        return state.q

    def within(self, state: ReducedState, limit: float) -> bool:
        """Whether the mass-weighted root mean square of U q is at most so many metres."""
        return bool(state.q @ self.mass @ state.q <= limit**2 * self._total_mass)

    def force(self, q: Array) -> tuple[float, Array]:
        """Elastic energy, J, and Uᵀf of a pose, (k,) N."""
        gradient = np.zeros((self.scene.mesh.n_vertices, 3))
        energy = add_elastic_gradient(self.scene.elements, (self._U @ q).reshape(-1, 3), gradient)
        return energy, self._UT @ gradient.ravel()

    def stiffness(self, u: Array) -> Array:
        """K̃ = UᵀK(u)U at displacements (n, 3), points clamped to be semidefinite, (k, k)."""
        blocks = self._pattern.stiffness_blocks(self.scene.elements, u, clamp=True)
        tangent: Array = self._free.T @ (self._pattern.matrix(blocks) @ self._free)
        return tangent

    def step(self, state: ReducedState, loads: Loads) -> tuple[ReducedState, Solution]:
        """The next state, and the minimiser's record."""
        assert not loads.pins and loads.gravity is None
        predictor = 2 * state.q - state.q_previous
        springs = [self._spring(grab) for grab in loads.grabs]

        def potential(z: Array, gradient: Array) -> float:
            q = self._decoded(z)
            value, force = self.force(q)
            if not value < np.inf:
                return np.inf
            momentum = self._inertia @ (q - predictor)
            value += 0.5 * float((q - predictor) @ momentum) - float(self._load @ q)
            force = force + momentum - self._load
            for B, offset, stiffness in springs:
                pull = B @ q + offset
                value += 0.5 * stiffness * float(pull @ pull)
                force += stiffness * (B.T @ pull)
            gradient[:] = force if self.decoder.is_identity else self.decoder.vjp(z, force)
            return value

        z = _start(potential, state)
        metric = self._metric(state.q, springs)
        if not self.decoder.is_identity:
            J = self.decoder.jacobian(z)
            metric = J.T @ metric @ J
        factor = cho_factor(metric)
        done = minimise(potential, z, lambda d: cho_solve(factor, d), TOLERANCE, max_iterations=200)
        self._age += 1 if done.iterations <= GIVE_UP else KEPT
        return ReducedState.moving(z, state.z, self._decoded(z), state.q), done

    def _decoded(self, z: Array) -> Array:
        return z.copy() if self.decoder.is_identity else self.decoder(z)

    def _spring(self, grab: Grab) -> tuple[Array, Array, float]:
        """B and c₀ − target of the centroid c = B q + c₀, and the stiffness."""
        centre = self.scene.mesh.vertices[grab.vertices].mean(axis=0)
        return self._fields[grab.vertices].mean(axis=0), centre - grab.target, grab.stiffness

    def _metric(self, q: Array, springs: list[tuple[Array, Array, float]]) -> Array:
        if self._stiffness is None or self._age >= KEPT:
            self._stiffness = self.stiffness((self._U @ q).reshape(-1, 3))
            self._age = 0
        metric = self._inertia + self._stiffness
        for B, _, stiffness in springs:
            metric = metric + stiffness * (B.T @ B)
        return metric


def _start(potential: Callable[[Array, Array], float], state: ReducedState) -> Array:
    """Extrapolated, unless that inverts an element."""
    z: Array = 2 * state.z - state.z_previous
    return z if potential(z, np.empty_like(z)) < np.inf else state.z.copy()
