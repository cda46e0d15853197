"""Full-space stepping: L-BFGS preconditioned by a factor of the Hessian at an earlier state of the same motion.

The factor is renewed when it pays: every iteration beyond those of the first step after a factorisation is excess, and
once the excess adds up to the cost of a factorisation, a new one is made. Costs are counted in iterations, not
seconds, so a run repeats exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.potential import IncrementalPotential
from ldsim.mechanics.motion import Grab
from ldsim.mechanics.elastic import vertex_rotations
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern, vertex_graph
from ldsim.solvers.lbfgs import minimise
from ldsim.solvers.solution import Reason, Solution
from ldsim.solvers.sparse import Factor, nested_dissection

Array = NDArray[np.float64]


@dataclass(eq=False)
class FullState:
    """All that the next step depends on, so that a resumed run repeats an undisturbed one.

    Attributes:
        u, u_previous: displacements of the last two frames, (n, 3) float64, metres.
        u_factor: the displacement at which the preconditioner was factorised, (n, 3) float64, metres.
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


class FactorisedHessian:
    """H = M/h² + K(u), eigenvalues clamped, factorised, with the grabs' rank-three terms by Woodbury's identity."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        graph = vertex_graph(scene.points.nodes, scene.free, scene.mesh.n_vertices)
        self._pattern = StiffnessPattern(
            scene.points.nodes, scene.free[nested_dissection(graph)], scene.mesh.n_vertices
        )
        self._inertia = self._pattern.blocks_of(scene.mass) / scene.time_step**2
        self._factor: Factor | None = None
        self._factor_rotations = np.empty((scene.mesh.n_vertices, 3, 3))
        self._turn = None
        self._grabs: list[tuple[NDArray[np.int64], float]] = []
        self._columns = np.empty((scene.mesh.n_vertices * 3, 0))
        self._small = np.empty((0, 0))

    def factorise(self, u: Array) -> None:
        """Factorise at displacement u, (n, 3)."""
        blocks = self._pattern.stiffness_blocks(self._scene.elements, u, clamp=True)
        blocks[:, range(3), range(3)] += self._inertia[:, None]
        self._factor = Factor(self._pattern.matrix(blocks))
        self._grabs = []
        vertex_rotations(self._scene.elements, u, self._factor_rotations)
        self._turn = None

    def align(self, u: Array) -> None:
        rotations = np.empty_like(self._factor_rotations)
        vertex_rotations(self._scene.elements, u, rotations)
        self._turn = np.einsum("vij,vkj->vik", rotations, self._factor_rotations)[self._pattern.order]
        self._grabs = []

    def solve_free(self, right: Array) -> Array:
        """(M/h² + K)⁻¹ right without grabs, (3n,) → (3n,); zero at pinned vertices."""
        assert self._factor is not None
        order = self._pattern.order
        solution = np.zeros((self._scene.mesh.n_vertices, 3))
        free = right.reshape(-1, 3)[order]
        if self._turn is not None:
            free = np.einsum("vji,vj->vi", self._turn, free)
        x = self._factor.solve(np.ascontiguousarray(free).ravel()).reshape(-1, 3)
        if self._turn is not None:
            x = np.einsum("vij,vj->vi", self._turn, x)
        solution[order] = x
        return solution.ravel()

    def set_grabs(self, grabs: Sequence[Grab]) -> None:
        """Include Σ k AᵀA of the grabs, A the centroid's rows; solves three columns for each new set."""
        key = [(grab.vertices, grab.stiffness) for grab in grabs]
        if len(key) == len(self._grabs) and all(
            a is b and k == stiffness for (a, k), (b, stiffness) in zip(key, self._grabs, strict=True)
        ):
            return
        self._grabs = key
        if not key:
            return
        rows = np.zeros((3 * len(key), self._scene.mesh.n_vertices, 3))
        for i, (vertices, stiffness) in enumerate(key):
            for axis in range(3):
                rows[3 * i + axis, vertices, axis] = np.sqrt(stiffness) / len(vertices)
        flat = rows.reshape(len(rows), self._scene.mesh.n_vertices * 3)
        self._columns = np.array([self.solve_free(row) for row in flat]).reshape(len(flat), -1).T
        self._rows = flat
        self._small = np.eye(len(rows)) + flat @ self._columns

    def solve(self, right: Array) -> Array:
        """H⁻¹ right with the grabs, (3n,) → (3n,)."""
        solution = self.solve_free(right)
        if self._grabs:
            solution -= self._columns @ np.linalg.solve(self._small, self._rows @ solution)
        return solution


class FullStepper:
    """Steps a scene in the full space.

    Args:
        tolerance: stop at ‖∇E‖ ≤ tolerance · max(‖u‖, 1), N.
        factor_cost: cost of a factorisation, in iterations.
    """

    def __init__(
        self, scene: Scene, tolerance: float = 1e-6, factor_cost: int = 40, max_iterations: int = 500
    ) -> None:
        self._scene = scene
        self._tolerance = tolerance
        self._factor_cost = factor_cost
        self._max_iterations = max_iterations
        self._hessian = FactorisedHessian(scene)
        self._factorised_at: Array | None = None
        self.factorisations = 0

    def step(self, state: FullState, grabs: Sequence[Grab]) -> tuple[FullState, Solution]:
        """Advance by one time step; the returned state is new, the given one unchanged."""
        u_factor, fresh, excess = state.u_factor, state.fresh_iterations, state.excess
        if excess > self._factor_cost:
            u_factor, fresh, excess = state.u, -1, 0
        self._factorise(u_factor)
        import os
        if os.environ.get('ALIGN') == '1': self._hessian.align(state.u)
        self._hessian.set_grabs(grabs)
        predictor = 2 * state.u - state.u_previous
        potential = IncrementalPotential(self._scene, predictor, grabs)
        x, start_evaluations = self._start(potential, state)

        def refresh(trial: Array, iteration: int) -> bool:
            nonlocal u_factor, fresh
            if iteration == 0 or iteration % self._factor_cost:
                return False
            u_factor, fresh = trial.reshape(-1, 3).copy(), -1
            self._factorise(u_factor)
            self._hessian.set_grabs(grabs)
            return True

        solution = minimise(
            potential.value_gradient,
            x,
            self._hessian.solve,
            self._tolerance,
            max_iterations=self._max_iterations,
            refresh=refresh,
        )
        if fresh < 0:
            fresh, excess = solution.iterations, 0
        else:
            excess += max(solution.iterations - fresh, 0)
        advanced = FullState(x.reshape(-1, 3), state.u, u_factor, fresh, excess)
        counted = Solution(
            solution.value,
            solution.gradient_norm,
            solution.iterations,
            solution.evaluations + start_evaluations,
            solution.reason,
        )
        return advanced, counted

    def _factorise(self, u: Array) -> None:
        if self._factorised_at is None or not np.array_equal(u, self._factorised_at):
            self._hessian.factorise(u)
            self._factorised_at = u.copy()
            self.factorisations += 1

    def _start(self, potential: IncrementalPotential, state: FullState) -> tuple[Array, int]:
        """The better of û and uₙ as the initial guess, with the evaluations this took."""
        predicted = (2 * state.u - state.u_previous).ravel()
        gradient = np.empty_like(predicted)
        value = potential.value_gradient(predicted, gradient)
        stay = state.u.ravel().copy()
        if value <= potential.value_gradient(stay, gradient):
            return predicted, 2
        return stay, 2


__all__ = ["FactorisedHessian", "FullState", "FullStepper", "Reason"]
