"""The full-space preconditioner: a factor of the Hessian at an earlier state, turned along with the solid.

H = M/h² + K(u), eigenvalues clamped, is factorised at some state of the motion. Where the solid has since rotated, K
has rotated with it: K(u) ≈ R K(u_f) Rᵀ with one rotation a vertex, as in stiffness warping (Müller et al. 2002).
Turning the right-hand side into the factor's frame and back costs little and lets one factor serve four times as long.
Grabs add Σ k AᵀA of rank three each, included by Woodbury's identity.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldsim.mechanics.elastic import vertex_rotations
from ldsim.mechanics.motion import Grab
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern, vertex_graph
from ldsim.solvers.sparse import Factor, nested_dissection

Array = NDArray[np.float64]


class TurnedHessian:
    """H⁻¹ of a scene, factorised at one displacement and turned to others."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        n = scene.mesh.n_vertices
        graph = vertex_graph(scene.points.nodes, scene.free, n)
        self._pattern = StiffnessPattern(scene.points.nodes, scene.free[nested_dissection(graph)], n)
        self._inertia = self._pattern.blocks_of(scene.mass) / scene.time_step**2
        self._factor: Factor | None = None
        self._factor_rotations = np.empty((n, 3, 3))
        self._rotations = np.empty((n, 3, 3))
        self._turn = np.empty((self._pattern.n_free, 3, 3))
        self._rows = np.empty((0, 3 * n))
        self._columns = np.empty((3 * n, 0))
        self._capacitance = np.empty((0, 0))

    def set_scene(self, scene: Scene) -> None:
        """Take the material from another scene of the same solid; the factor is as it was until the next one."""
        self._scene = scene

    def factorise(self, u: Array) -> None:
        """Factorise at displacement u, (n, 3) metres."""
        blocks = self._pattern.stiffness_blocks(self._scene.elements, u, clamp=True)
        blocks[:, range(3), range(3)] += self._inertia[:, None]
        self._factor = Factor(self._pattern.matrix(blocks))
        vertex_rotations(self._scene.elements, u, self._factor_rotations)

    def prepare(self, u: Array, grabs: Sequence[Grab]) -> None:
        """Turn the factor to displacement u, (n, 3) metres, and include the grabs."""
        vertex_rotations(self._scene.elements, u, self._rotations)
        turn = np.einsum("vij,vkj->vik", self._rotations, self._factor_rotations)
        self._turn = turn[self._pattern.order]
        self._rows = grab_rows(grabs, self._scene.mesh.n_vertices)
        self._columns = np.empty((self._rows.shape[1], len(self._rows)))
        for i, row in enumerate(self._rows):
            self._columns[:, i] = self.solve_without_grabs(row)
        self._capacitance = np.eye(len(self._rows)) + self._rows @ self._columns

    def solve_without_grabs(self, right: Array) -> Array:
        """R (M/h² + K(u_f))⁻¹ Rᵀ right, (3n,) → (3n,); zero at pinned vertices."""
        assert self._factor is not None, "factorise first"
        order = self._pattern.order
        turned = np.einsum("vji,vj->vi", self._turn, right.reshape(-1, 3)[order])
        x = self._factor.solve(turned.ravel()).reshape(-1, 3)
        solution = np.zeros((self._scene.mesh.n_vertices, 3))
        solution[order] = np.einsum("vij,vj->vi", self._turn, x)
        return solution.ravel()

    def solve(self, right: Array) -> Array:
        """H⁻¹ right with the grabs, (3n,) → (3n,)."""
        solution = self.solve_without_grabs(right)
        if len(self._rows):
            solution -= self._columns @ np.linalg.solve(self._capacitance, self._rows @ solution)
        return solution


def grab_rows(grabs: Sequence[Grab], n_vertices: int) -> Array:
    """√k A of every grab, (3 · grabs, 3n) float64, with A u the displacement of the centroid."""
    rows = np.zeros((len(grabs), 3, n_vertices, 3))
    for i, grab in enumerate(grabs):
        for axis in range(3):
            rows[i, axis, grab.vertices, axis] = np.sqrt(grab.stiffness) / len(grab.vertices)
    return rows.reshape(3 * len(grabs), 3 * n_vertices)
