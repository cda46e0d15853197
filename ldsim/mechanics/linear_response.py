"""What a solid does near rest: under forces, under its own weight, by itself (linear elasticity)."""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, eye_array, kron
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from ldsim.arrays import Array, Indices
from ldsim.mechanics.elastic import point_stresses
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.optimise.elimination import Elimination
from ldsim.optimise.sparse import Factor

# The strain at which stresses are taken: large against rounding, small against one.
PROBE = 1e-4
# Of eigenvalues: they are read in two digits.
ACCURACY = 1e-4
# Two eigenvectors of K_σ for one load factor, so that a pair of equal ones does not stall the iteration.
PAIR = 2
# Of Lanczos for the load factor: one below 1 lies far from the others, and two or three find it.
RESTARTS = 30
# Lanczos may miss the last of a pair of equal frequencies; so many more are found than are asked for.
SPARE = 6


class LinearResponse:
    """K at rest of a scene, factorised.

    Args:
        order: the free vertices in the order of the matrix, (f,) int64.
        elimination: the structure of the factor in that order.

    Raises:
        SolverError: the pins let the solid turn or float.
    """

    def __init__(self, scene: Scene, order: Indices, elimination: Elimination) -> None:
        self.scene, self._order = scene, order
        self._pattern = StiffnessPattern(scene.points.nodes, order, scene.mesh.n_vertices)
        blocks = self._blocks(np.zeros_like(scene.mesh.vertices))
        self._stiffness = self._pattern.matrix(blocks)
        self._factor = Factor(elimination, self._pattern.indptr, self._pattern.columns, blocks)

    def displacement(self, force: Array) -> Array:
        """u with K u = f, (n, 3) metres, of a force (n, 3), N; zero where pinned."""
        u = np.zeros_like(self.scene.mesh.vertices)
        u[self._order] = self._factor.solve(force[self._order].ravel()).reshape(-1, 3)
        return u

    def of_grip(self, vertices: Indices) -> Array:
        """What a unit force on the centroid of some vertices moves, by axis of the force, (n, 3, 3), m/N."""
        force = np.zeros((3, *self.scene.mesh.vertices.shape))
        for axis in range(3):
            force[axis, vertices, axis] = 1 / len(vertices)
        return np.stack([self.displacement(f) for f in force], axis=2)

    def strain(self, u: Array) -> Array:
        """‖sym ∇u‖ at each quadrature point, (s,): the square root of the sum of the squares of its entries."""
        points = self.scene.points
        gradient = np.einsum("sai,saj->sij", u[points.nodes], points.gradients)
        found: Array = np.linalg.norm(0.5 * (gradient + gradient.transpose(0, 2, 1)), axis=(1, 2))
        return found

    def frequencies(self, count: int) -> Array:
        """The slowest frequencies, ascending, (count,) Hz: K φ = ω² M φ."""
        size = self._stiffness.shape[0]
        squares = eigsh(
            self._stiffness,
            min(count + SPARE, size - 1),
            M=self._expanded(self.scene.mass),
            sigma=0.0,
            OPinv=self._inverse,
            tol=ACCURACY,
            v0=np.random.default_rng(0).normal(size=size),
            return_eigenvectors=False,
        )
        return np.sqrt(np.sort(squares)[:count]) / (2 * math.pi)

    def load_factor(self, force: Array) -> float:
        """How many times a dead load (n, 3), N, must act until the solid buckles; infinite where it never does.

        Linear buckling: the smallest λ > 0 with (K + λ K_σ) φ = 0, where K_σ = Σ_s w_s (∇N_aᵀ σ_s ∇N_b) I is the
        stiffness of the stress σ under the load. The derivative of K along u would count its rotation too, to
        first order alone, and so see a cantilever buckle that only bends.
        """
        u = self.displacement(force)
        strain = float(self.strain(u).max())
        if strain == 0:
            return math.inf
        size = self._stiffness.shape[0]
        try:
            found = eigsh(
                -self._expanded(self._stress_stiffness(u, PROBE / strain)),
                min(PAIR, size - 1),
                M=self._stiffness,
                Minv=self._inverse,
                which="LA",
                tol=ACCURACY,
                maxiter=RESTARTS,
                v0=np.random.default_rng(0).normal(size=size),
                return_eigenvectors=False,
            )
        except ArpackNoConvergence as error:  # of a solid that hangs they lie close together, all near 0
            found = np.asarray(error.eigenvalues, dtype=np.float64)
        largest = float(found.max(initial=0.0))
        return 1 / largest if largest > 0 else math.inf

    def _stress_stiffness(self, u: Array, step: float) -> csr_array:
        """K_σ of a displacement, one number for each pair of vertices, (n, n), N/m."""
        points, n = self.scene.points, self.scene.mesh.n_vertices
        stress = np.empty((points.n_points, 9))
        point_stresses(self.scene.elements, step * u, stress)
        sigma = stress.reshape(-1, 3, 3) / step
        local = np.einsum("s,sai,sij,sbj->sab", points.weights, points.gradients, sigma, points.gradients)
        rows = np.broadcast_to(points.nodes[:, :, None], local.shape)
        columns = np.broadcast_to(points.nodes[:, None, :], local.shape)
        return coo_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsr()

    def _expanded(self, scalar: csr_array) -> csc_array:
        """What acts on each axis alike, over the unknowns."""
        return csc_array(kron(scalar[self._order][:, self._order], eye_array(3)))

    @property
    def _inverse(self) -> LinearOperator:
        return LinearOperator(self._stiffness.shape, matvec=self._factor.solve, dtype=np.float64)

    def _blocks(self, u: Array) -> Array:
        return self._pattern.stiffness_blocks(self.scene.elements, u, clamp=False)
