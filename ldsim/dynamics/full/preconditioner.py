"""The Hessian of the full space and its inverse: made at one state of the motion, warped along with the solid.

H = M/h² + K(u), eigenvalues clamped. Newton makes it anew in every iteration; as the preconditioner of L-BFGS one
serves for many steps. Where the solid has since rotated, K has rotated with it: K(u) ≈ R K(u_f) Rᵀ with one rotation a
vertex, as in stiffness warping (Müller et al. 2002). Rotating the right-hand side into the frame of the old state and
back costs little and lets one factor serve four times as long. Grabs add Σ k AᵀA of rank three each, included by
Woodbury's identity.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.dynamics.full.linear_choice import LinearChoice, choose
from ldsim.jit import njit
from ldsim.mechanics.elastic import vertex_rotations
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.optimise.multigrid import Multigrid
from ldsim.optimise.sparse import Factor

# Without inertia, the clamped stiffness of a buckled state may be singular; this share of the rest stiffness is added.
STATIC_SHIFT = 1e-9


class WarpedHessian:
    """H⁻¹ of a scene, made at one displacement and warped to others.

    Args:
        choice: how it is inverted.
        exact: solve to a residual that serves Newton; otherwise as cheaply as serves a preconditioner.
        inertia: whether M/h² is part of it.

    Attributes:
        factorisations: how many were made.
    """

    def __init__(
        self, scene: Scene, choice: LinearChoice | None = None, exact: bool = True, inertia: bool = True
    ) -> None:
        self._scene = scene
        self._choice = choice or choose(scene, "direct")
        self._exact = exact
        n = scene.mesh.n_vertices
        self._pattern = StiffnessPattern(scene.points.nodes, self._choice.order, n)
        self._diagonal = self._inertia(inertia)
        self._inverse: Factor | Multigrid | None = None
        self._at: Array | None = None
        self.factorisations = 0
        self._factor_rotations = np.empty((n, 3, 3))
        self._rotations = np.empty((n, 3, 3))
        self._relative = np.empty((self._pattern.n_free, 3, 3))
        self._rows = np.empty((0, 3 * n))
        self._columns = np.empty((3 * n, 0))
        self._capacitance = np.empty((0, 0))

    def _inertia(self, inertia: bool) -> Array:
        """What is added to the diagonal of every block, (b,): M/h², or a whiff of stiffness where there is none."""
        if inertia:
            return self._pattern.blocks_of(self._scene.mass) / self._scene.time_step**2
        rest = np.zeros((self._scene.mesh.n_vertices, 3))
        blocks = self._pattern.stiffness_blocks(self._scene.elements, rest, clamp=True)
        on_diagonal = self._pattern.rows == self._pattern.columns
        return np.where(on_diagonal, STATIC_SHIFT * np.einsum("bii->b", blocks) / 3, 0.0)

    def factorise(self, u: Array) -> None:
        """Make the inverse at displacement u, (n, 3) metres; nothing is done where that is where it was made last."""
        if self._at is not None and np.array_equal(u, self._at):
            return
        pattern, elimination = self._pattern, self._choice.elimination
        self._at = self._inverse = None  # the old one makes room before the new one is made
        blocks = pattern.stiffness_blocks(self._scene.elements, u, clamp=True)
        blocks[:, range(3), range(3)] += self._diagonal[:, None]
        if elimination is not None:
            self._inverse = Factor(elimination, pattern.indptr, pattern.columns, blocks, single=not self._exact)
        else:
            positions = (self._scene.mesh.vertices + u)[pattern.order]
            self._inverse = Multigrid(pattern.indptr, pattern.columns, blocks, positions, exact=self._exact)
        vertex_rotations(self._scene.elements, u, self._factor_rotations)
        self._at, self.factorisations = u.copy(), self.factorisations + 1

    def prepare(self, u: Array, grabs: Sequence[Grab]) -> None:
        """Warp the inverse to displacement u, (n, 3) metres, and include the grabs."""
        vertex_rotations(self._scene.elements, u, self._rotations)
        self._relative = (self._rotations @ self._factor_rotations.transpose(0, 2, 1))[self._pattern.order]
        self._rows = grab_rows(grabs, self._scene.mesh.n_vertices)
        self._columns = np.empty((self._rows.shape[1], len(self._rows)))
        for i, row in enumerate(self._rows):
            self._columns[:, i] = self.solve_without_grabs(row)
        self._capacitance = np.eye(len(self._rows)) + self._rows @ self._columns

    def solve_without_grabs(self, right: Array) -> Array:
        """R (M/h² + K(u_f))⁻¹ Rᵀ right, (3n,) → (3n,); zero at pinned vertices."""
        assert self._inverse is not None, "factorise first"
        rotated = rotated_back(self._relative, self._pattern.order, right)
        return rotated_forth(self._relative, self._pattern.order, self._inverse.solve(rotated), len(right))

    def solve(self, right: Array) -> Array:
        """H⁻¹ right with the grabs, (3n,) → (3n,)."""
        solution = self.solve_without_grabs(right)
        if len(self._rows):
            solution -= self._columns @ np.linalg.solve(self._capacitance, self._rows @ solution)
        return solution


@njit(cache=True, nogil=True)
def rotated_back(R: Array, order: Indices, right: Array) -> Array:
    """Rᵀ right over the free vertices in the order of the matrix, (3n,) → (3f,)."""
    x = np.empty(3 * order.shape[0])
    for i in range(order.shape[0]):
        v = 3 * order[i]
        for j in range(3):
            x[3 * i + j] = R[i, 0, j] * right[v] + R[i, 1, j] * right[v + 1] + R[i, 2, j] * right[v + 2]
    return x


@njit(cache=True, nogil=True)
def rotated_forth(R: Array, order: Indices, x: Array, size: int) -> Array:
    """R x at the free vertices and zero at the pinned ones, (3f,) → (size,)."""
    solution = np.zeros(size)
    for i in range(order.shape[0]):
        v = 3 * order[i]
        for j in range(3):
            solution[v + j] = R[i, j, 0] * x[3 * i] + R[i, j, 1] * x[3 * i + 1] + R[i, j, 2] * x[3 * i + 2]
    return solution


def grab_rows(grabs: Sequence[Grab], n_vertices: int) -> Array:
    """√k A of every grab, (3 · grabs, 3n) float64, with A u the displacement of the centroid."""
    rows = np.zeros((len(grabs), 3, n_vertices, 3))
    for i, grab in enumerate(grabs):
        for axis in range(3):
            rows[i, axis, grab.vertices, axis] = np.sqrt(grab.stiffness) / len(grab.vertices)
    return rows.reshape(3 * len(grabs), 3 * n_vertices)
