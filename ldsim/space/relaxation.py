"""Relaxation: given r coordinates z, all the rest of a solid in static equilibrium (static condensation, nonlinear).

    u₀(z) = argmin { V(u) : W u = z },  W = VᵀM,  V mass-orthonormal, with the elastic energy V(u)

    V_eff(z) = V(u₀(z)),   ∇V_eff = λ,   ∇²V_eff = S = (W K⁻¹ Wᵀ)⁻¹,   ∂u₀/∂z = T = K⁻¹ Wᵀ S,   K = ∂²V/∂u² at u₀(z)

λ is the multiplier of the constraint: at u₀ the elastic force is Wᵀλ. At rest these are static condensation (Guyan
1965) and residual flexibility (MacNeal 1971); away from it, implicit condensation (Touzé, Vizzaccaro and Thomas 2021,
arXiv 2107.05077). No load is in V(u): what acts on the solid acts on u₀(z) when it is stepped.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ldsim.arrays import Array
from ldsim.errors import SolverError
from ldsim.mechanics.elastic import add_elastic_gradient, vertex_rotations
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern, vertex_graph
from ldsim.optimise.elimination import eliminate, elimination_order
from ldsim.optimise.minimiser import minimise
from ldsim.optimise.solution import Reason, Solution
from ldsim.optimise.sparse import Factor
from ldsim.space.basis import Basis, weighted

# The force that no constraint carries may be this share of the forces of a typical strain.
TOLERANCE = 1e-9
MAX_ITERATIONS = 200
# K is turned along with the solid or made anew, alternately, after these iterations of L-BFGS and after every so many:
# soon where a guess is far off, for its K says little of where it settles (what a grip holds is all but crushed). A
# factor costs some `SPARED` iterations, so this is done only where more are left at the pace since the last time.
EARLY, RENEWAL, SPARED = (1, 2, 4), 8, 20
# Relative residual of the tangents where K is indefinite.
ACCURACY = 1e-8
# A path to a far z is cut in halves so often.
HALVINGS = 2


@dataclass(frozen=True, eq=False)
class Relaxed:
    """A pose in which everything but z is in equilibrium.

    Attributes:
        z: (r,) float64.
        u: u₀(z), (n, 3) float64, metres.
        energy: V_eff(z), J.
        force: λ = ∇V_eff, (r,) float64.
        stiffness: S = ∇²V_eff, (r, r) float64, symmetric; indefinite where the solid would buckle, were z let go.
        tangents: T = ∂u₀/∂z, (n, 3, r) float64.
        solution: how the equilibrium was found.
        inverse: of K there, for the poses that are found from it; a factor is large, so who keeps many poses drops it.
    """

    z: Array
    u: Array
    energy: float
    force: Array
    stiffness: Array
    tangents: Array
    solution: Solution
    inverse: _Constrained | None = None


class Relaxation:
    """Finds u₀(z) and its derivatives for the coordinates of some columns V.

    Args:
        coordinates: V, columns orthonormal in the scene's mass and zero where it is pinned; z = VᵀM u.

    Raises:
        SolverError: V is not of this scene or not orthonormal in its mass, or the solid is not held by its pins.
    """

    def __init__(self, scene: Scene, coordinates: Basis) -> None:
        if not scene.pinned.any():
            raise SolverError("a condensed space needs pins: a solid that floats has no equilibrium; set mesh.pins")
        self.scene, self.coordinates = scene, coordinates
        V = np.where(scene.pinned[:, None, None], 0.0, coordinates.fields).reshape(-1, coordinates.k)
        self._V = V
        self.rows = np.ascontiguousarray(weighted(scene.mass, np.ascontiguousarray(V.T)))  # (r, 3n)
        self.rows.reshape(len(self.rows), -1, 3)[:, scene.pinned] = 0.0
        gram = self.rows @ V
        if not np.allclose(gram, np.eye(len(gram)), atol=1e-6):
            raise SolverError("the coordinates of a condensed space must be orthonormal in the mass and zero at pins")
        nodes, n, free = scene.points.nodes, scene.mesh.n_vertices, scene.free
        order = free[elimination_order(vertex_graph(nodes, free, n))]
        self._pattern = StiffnessPattern(nodes, order, n)
        self._elimination = eliminate(self._pattern.indptr, self._pattern.columns)
        zero = np.zeros((n, 3))
        self._size = float(np.abs(self._pattern.stiffness_blocks(scene.elements, zero, clamp=False)).max())
        self._at_rest = _Constrained(self, zero, exact=True)
        self.rest = self._derived(zero, Solution(0.0, 0.0, 0, 0, Reason.CONVERGED), self._at_rest)

    @property
    def r(self) -> int:
        return self.coordinates.k

    def encode(self, u: NDArray[np.floating]) -> Array:
        """z = W u of displacements (b, n, 3), metres; (b, r)."""
        return u.reshape(len(u), -1) @ self.rows.T

    def __call__(self, z: Array, start: Relaxed | None = None) -> Relaxed:
        """The relaxed pose at z, (r,), found by following the solid from another relaxed pose, or from rest.

        Raises:
            SolverError: no equilibrium was found on the way.
        """
        return self._follow(z, self.rest if start is None else start, HALVINGS)

    def from_pose(self, u: NDArray[np.floating]) -> Relaxed:
        """The relaxed pose with the coordinates of a displacement, (n, 3) metres, found from that, or else from rest.

        Raises:
            SolverError: no equilibrium was found.
        """
        start = np.where(self.scene.pinned[:, None], 0.0, u)
        try:
            return self._derived(*self._settle(start, _Constrained(self, start, exact=False)))
        except SolverError:  # the pose of a linear basis may be inverted, where some materials have infinite energy
            return self(self.rows @ start.ravel())

    def residual(self, force: Array) -> Array:
        """C f, what forces (…, n, 3), N, move while z is held, to first order at rest, (…, n, 3) metres."""
        free = np.where(self.scene.pinned[:, None], 0.0, force)
        return self._at_rest.solve(free.reshape(-1, 3 * self.scene.mesh.n_vertices)).reshape(force.shape)

    def _follow(self, z: Array, start: Relaxed, halvings: int) -> Relaxed:
        guess = start.u + start.tangents @ (z - start.z)
        near = _Constrained(self, start.u, exact=False) if start.inverse is None else start.inverse
        try:
            return self._derived(*self._settle(guess, near))
        except SolverError:
            if halvings == 0:
                raise
        middle = self._follow(0.5 * (z + start.z), start, halvings - 1)
        return self._follow(z, middle, halvings - 1)

    def _settle(self, guess: Array, near: _Constrained) -> tuple[Array, Solution]:
        """Minimise V(u) over W u = W guess, from the guess, with the inverse of K at a pose near by, turned to it.

        L-BFGS with the constrained inverse of K for a preconditioner; gradients and directions stay in the kernel of W.
        """
        scene, x = self.scene, guess.ravel().copy()
        inverse, size, made_anew = near.turned(guess), math.inf, True
        renewed = 0, math.inf  # in which iteration, and the forces that were left
        # forces of the size of K₀ times a tiny share of the solid, over all of its unknowns
        tolerance = TOLERANCE * self._size * scene.mesh.diagonal

        def objective(u: Array, gradient: Array) -> float:
            nonlocal size
            force = np.zeros((scene.mesh.n_vertices, 3))
            value = add_elastic_gradient(scene.elements, u.reshape(-1, 3), force)
            force[scene.pinned] = 0.0
            gradient[:] = self.without_multiplier(force.ravel())
            size = float(np.linalg.norm(gradient))
            return float(value)

        def refresh(u: Array, iteration: int) -> bool:
            nonlocal inverse, made_anew, renewed
            if iteration == 0:
                renewed = 0, size
            if iteration == 0 or (iteration % RENEWAL and iteration not in EARLY):
                return False
            pace = math.log(renewed[1] / size) / (iteration - renewed[0])
            if pace * SPARED >= math.log(size / tolerance):
                return False
            pose, made_anew, renewed = u.reshape(-1, 3), not made_anew, (iteration, size)
            inverse = _Constrained(self, pose, exact=False) if made_anew else inverse.turned(pose)
            return True

        norm = max(float(np.linalg.norm(x)), 1.0)
        solution = minimise(
            objective, x, lambda g: inverse.solve(g[None])[0], tolerance / norm, 8, MAX_ITERATIONS, refresh
        )
        if not solution.converged and solution.gradient_norm > 1e2 * tolerance:
            raise SolverError(
                f"no equilibrium was found for a condensed pose ({solution.reason.words}, {solution.gradient_norm:.3g} "
                "N are left); use smaller motions, or a material that stays finite (stable_neo_hookean)"
            )
        return x.reshape(-1, 3), solution

    def without_multiplier(self, force: Array) -> Array:
        """The part of forces, (…, 3n), that the constraint does not carry: (1 − WᵀVᵀ) f."""
        return force - (force @ self._V) @ self.rows

    def _derived(self, u: Array, solution: Solution, inverse: _Constrained | None = None) -> Relaxed:
        """λ, S and T at an equilibrium, where K may have been inverted before."""
        force = np.zeros_like(u)
        energy = float(add_elastic_gradient(self.scene.elements, u, force))
        force[self.scene.pinned] = 0.0
        inverse = _Constrained(self, u, exact=True) if inverse is None else inverse
        z, multiplier = self.rows @ u.ravel(), self._V.T @ force.ravel()
        tangents = inverse.tangents.T.reshape(*u.shape, -1)
        return Relaxed(z, u, energy, multiplier, inverse.stiffness, tangents, solution, inverse)

    def factor(self, u: Array, clamp: bool) -> Factor:
        """Of K(u) over the free vertices; in single precision where it is clamped, for then it only preconditions.

        Raises:
            SolverError: it is not positive definite.
        """
        blocks = self._pattern.stiffness_blocks(self.scene.elements, u, clamp=clamp)
        return Factor(self._elimination, self._pattern.indptr, self._pattern.columns, blocks, single=clamp)

    def stiffness(self, u: Array) -> csr_array:
        """K(u) with zero rows and columns at the pins, (3n, 3n)."""
        blocks = self._pattern.stiffness_blocks(self.scene.elements, u, clamp=False)
        free = self._pattern.matrix(blocks).tocoo()
        unknown = (3 * self._pattern.order[:, None] + np.arange(3)).ravel()
        size = 3 * self.scene.mesh.n_vertices
        return coo_array((free.data, (unknown[free.row], unknown[free.col])), shape=(size, size)).tocsr()

    def rotations(self, u: Array) -> Array:
        """Of the solid at each vertex, (n, 3, 3)."""
        found = np.empty((len(u), 3, 3))
        vertex_rotations(self.scene.elements, u, found)
        return found

    def solve(self, factor: Factor, right: Array) -> Array:
        """K⁻¹ of rows (b, 3n); zero at the pins."""
        order, n, b = self._pattern.order, self.scene.mesh.n_vertices, len(right)
        x, some = np.zeros((b, n, 3)), right.reshape(b, n, 3)[:, order].reshape(b, -1)
        found = factor.solve(some[0])[None] if b == 1 else factor.solve_rows(some)
        x[:, order] = found.reshape(b, -1, 3)
        return x.reshape(b, 3 * n)


class _Constrained:
    """K at a pose under the constraint: its inverse among displacements with W u = 0, S and T.

    K itself may be indefinite where the constraint alone holds the solid. A factor of the clamped K then serves as the
    preconditioner of conjugate gradients in the kernel of W, where K is positive at any minimum.

    Args:
        exact: whether S and T are those of K, and not of the factor.

    Raises:
        SolverError: K is indefinite in the kernel of W: the pose is no minimum.
    """

    def __init__(self, relaxation: Relaxation, u: Array, exact: bool) -> None:
        self._relaxation = relaxation
        definite = exact
        if exact:
            try:
                self.factor = relaxation.factor(u, clamp=False)
            except SolverError:
                definite = False
        if not definite:
            self.factor = relaxation.factor(u, clamp=True)
        self._rotations = relaxation.rotations(u)
        self._constrain(None)
        if exact and not definite:
            self._correct(relaxation.stiffness(u))

    def _constrain(self, turn: Array | None) -> None:
        """S and T of the factor, turned by one rotation a vertex, (n, 3, 3), since it was made."""
        self._turn, W = turn, self._relaxation.rows
        Y = self._unconstrained(W)
        compliance = Y @ W.T
        self.stiffness: Array = np.asarray(np.linalg.inv(0.5 * (compliance + compliance.T)), dtype=np.float64)
        # not S Y: of a factor in single precision that would let z drift, a ten-millionth with every step
        self.tangents: Array = np.asarray(np.linalg.solve(compliance, Y), dtype=np.float64)  # (r, 3n)

    def _unconstrained(self, right: Array) -> Array:
        """R K⁻¹ Rᵀ of rows, (b, 3n)."""
        if self._turn is None:
            return self._relaxation.solve(self.factor, right)
        back = np.einsum("nji,bnj->bni", self._turn, right.reshape(len(right), -1, 3))
        x = self._relaxation.solve(self.factor, back.reshape(right.shape))
        forth = np.einsum("nij,bnj->bni", self._turn, x.reshape(back.shape))
        return np.ascontiguousarray(forth.reshape(right.shape))

    def _correct(self, K: csr_array) -> None:
        """T and S of K from those of the clamped one: T += x, W x = 0, with K T in the range of Wᵀ."""
        T = self.tangents
        exact = T + self._conjugate_gradients(K, -(K @ T.T).T)
        stiffness = exact @ (K @ exact.T)
        self.tangents, self.stiffness = exact, 0.5 * (stiffness + stiffness.T)

    def turned(self, u: Array) -> _Constrained:
        """The same factor, turned along with the solid to another pose, (n, 3) metres.

        K(u) ≈ R K(u_f) Rᵀ with one rotation a vertex (Müller et al. 2002, stiffness warping), at the cost of r solves.
        """
        rotations = self._relaxation.rotations(u)
        if np.array_equal(rotations, self._rotations):
            return self
        other = copy(self)
        other._constrain(rotations @ self._rotations.transpose(0, 2, 1))
        return other

    def _conjugate_gradients(self, K: csr_array, right: Array) -> Array:
        """Rows x with W x = 0 and K x = right up to what the constraint carries, (b, 3n)."""
        relaxation = self._relaxation
        x, residual = np.zeros_like(right), relaxation.without_multiplier(right)
        target = ACCURACY * np.linalg.norm(residual, axis=1)
        direction, before = np.zeros_like(right), np.ones(len(right))
        for iteration in range(MAX_ITERATIONS):
            left = np.flatnonzero(np.linalg.norm(residual, axis=1) > target)
            if not len(left):
                break
            step = self.solve(residual[left])
            now = np.sum(residual[left] * step, axis=1)
            direction[left] = step + (now / before[left] if iteration else 0.0 * now)[:, None] * direction[left]
            image = np.ascontiguousarray((K @ direction[left].T).T)
            curvature = np.sum(direction[left] * image, axis=1)
            if curvature.min() <= 0:
                raise SolverError("a condensed pose has buckled: what its coordinates leave free is in no stable rest")
            length = (now / curvature)[:, None]
            x[left] += length * direction[left]
            residual[left] -= length * relaxation.without_multiplier(image)
            before[left] = now
        else:
            raise SolverError(f"the tangents of a condensed pose are not known after {MAX_ITERATIONS} iterations")
        return x

    def solve(self, right: Array) -> Array:
        """The displacements with W u = 0 that forces cause, by the factor, (b, 3n)."""
        x = self._unconstrained(right)
        return x - (x @ self._relaxation.rows.T) @ self.tangents
