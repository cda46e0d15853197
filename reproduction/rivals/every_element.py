"""Reduced motion with every element integrated, so that cubature plays no part in what is measured.

Through the mesh: u = U φ(z), element forces on the vertices, Uᵀf. The reduced step of the package reads k numbers for
each strain of each point, which for all elements is some ten times as much memory in each evaluation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from ldsim.dynamics.reduced.stepper import reduced_mass
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mechanics.loads import Grab, MotionLoads
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.optimise.minimiser import minimise
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder

Array = NDArray[np.float64]

# Steps that a preconditioner serves, and iterations after which it is given up.
SERVES = 6
GIVE_UP = 12
TOLERANCE = 1e-6


class State(NamedTuple):
    """z and q of the last two frames; q need not be φ(z)."""

    z: Array
    z_previous: Array
    q: Array
    q_previous: Array


class EveryElement:
    """Steps a scene in the space u = U φ(z) by implicit Euler (paper, Eq. 12) with all quadrature points."""

    def __init__(self, scene: Scene, U: Array, decoder: Decoder) -> None:
        self.scene, self.U, self.decoder = scene, np.ascontiguousarray(U), decoder
        self._UT = np.ascontiguousarray(U.T)
        self._inertia = reduced_mass(scene, Basis.of(self.U, scene.mass)) / scene.time_step**2
        self._load = self._UT @ scene.external_force.ravel()
        self._pattern = StiffnessPattern(scene.points.nodes, scene.free, scene.mesh.n_vertices)
        self._free = np.ascontiguousarray(U.reshape(scene.mesh.n_vertices, 3, -1)[scene.free].reshape(-1, U.shape[1]))
        self._stiffness: Array | None = None
        self._age = 0

    def force(self, q: Array) -> tuple[float, Array]:
        """Elastic energy, J, and Uᵀf of a pose, (k,) N."""
        gradient = np.zeros((self.scene.mesh.n_vertices, 3))
        energy = add_elastic_gradient(self.scene.elements, (self.U @ q).reshape(-1, 3), gradient)
        return energy, self._UT @ gradient.ravel()

    def stiffness(self, u: Array) -> Array:
        """K̃ = UᵀK(u)U at displacements (n, 3), points clamped to be semidefinite, (k, k)."""
        blocks = self._pattern.stiffness_blocks(self.scene.elements, u, clamp=True)
        tangent: Array = self._free.T @ (self._pattern.matrix(blocks) @ self._free)
        return tangent

    def step(self, state: State, grabs: list[Grab]) -> tuple[State, int]:
        """The next state, and the iterations it took."""
        predictor = 2 * state.q - state.q_previous
        nodal = self.U.reshape(self.scene.mesh.n_vertices, 3, -1)
        springs = [
            (nodal[g.vertices].mean(axis=0), self.scene.mesh.vertices[g.vertices].mean(axis=0) - g.target, g.stiffness)
            for g in grabs
        ]

        def potential(z: Array, gradient: Array) -> float:
            q = z if self.decoder.is_identity else self.decoder(z)
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

        z = self._start(potential, state)
        metric = self._metric(state.q, springs)
        if not self.decoder.is_identity:
            J = self.decoder.jacobian(z)
            metric = J.T @ metric @ J
        factor = cho_factor(metric)
        done = minimise(potential, z, lambda d: cho_solve(factor, d), TOLERANCE, max_iterations=200)
        self._age += 1 if done.iterations <= GIVE_UP else SERVES
        q = z.copy() if self.decoder.is_identity else self.decoder(z)
        return State(z, state.z, q, state.q), done.iterations

    def _start(self, potential: Callable[[Array, Array], float], state: State) -> Array:
        """Extrapolated, unless that inverts an element."""
        z: Array = 2 * state.z - state.z_previous
        return z if potential(z, np.empty_like(z)) < np.inf else state.z.copy()

    def _metric(self, q: Array, springs: list[tuple[Array, Array, float]]) -> Array:
        if self._stiffness is None or self._age >= SERVES:
            self._stiffness = self.stiffness((self.U @ q).reshape(-1, 3))
            self._age = 0
        metric = self._inertia + self._stiffness
        for B, _, stiffness in springs:
            metric = metric + stiffness * (B.T @ B)
        return metric


def run(
    space: EveryElement,
    motion: Motion,
    held: dict[int, NDArray[np.int64]],
    frames: int,
    restart: Callable[[int], State | None] = lambda frame: None,
    progress: Callable[[int], None] = lambda frame: None,
) -> Array:
    """q of each frame, (frames, k); NaN from where the run is lost. `progress` is told the frames that are done."""
    loads = MotionLoads(motion, space.scene, held)
    rest = np.zeros(space.decoder.r), np.zeros(space.decoder.k)
    state = State(rest[0], rest[0], rest[1], rest[1])
    q = np.full((frames, space.decoder.k), np.nan)
    for frame in range(frames):
        state = restart(frame) or state
        u = (space.U @ state.q).reshape(-1, 3) if loads.needs_state(frame) else None
        state, _ = space.step(state, loads.at(frame, u).grabs)
        if not np.linalg.norm(state.q) < 1e6:
            break
        q[frame] = state.q
        progress(frame + 1)
    return q
