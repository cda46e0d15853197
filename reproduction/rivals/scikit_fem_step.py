"""The same implicit Euler step with scikit-fem's assembly and SciPy's solver: Newton, line search, same stop rule.

As a user who minds the time would write it: the tangent ∂P/∂F is made once an iteration for all quadrature points, by
NumPy, and the stiffness is assembled as the nine blocks of a scalar basis, which took 0.6 s on the X of 29,686 tets
where the form over the vector basis, with the tangent inside, took 2.6 s (processor time).
"""

from __future__ import annotations

import numpy as np
import skfem
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu
from skfem.helpers import ddot, det, grad, inv, transpose

from ldsim.arrays import Array
from ldsim.dynamics.full.stepper import FullState
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.scene import Scene
from ldsim.optimise.solution import Reason, Solution

IDENTITY = np.eye(3)


@skfem.LinearForm
def force(v, w):  # type: ignore[no-untyped-def]
    return ddot(w["P"], grad(v))


@skfem.BilinearForm
def block(u, v, w):  # type: ignore[no-untyped-def]
    return np.einsum("jl...,j...,l...->...", w["C"], grad(v), grad(u))


@skfem.BilinearForm
def mass(u, v, w):  # type: ignore[no-untyped-def]
    return u * v


class ScikitFemStepper:
    """Newton steps of the paper's neo-Hookean solid, uniform material, on tets; components one after another."""

    def __init__(self, scene: Scene, tolerance: float) -> None:
        self._tolerance = tolerance
        self._vertices, n = scene.mesh.vertices, scene.mesh.n_vertices
        self._mu, self._lam = scene.mu[0], scene.lam[0]
        mesh = skfem.MeshTet(scene.mesh.vertices.T.copy(), scene.mesh.cells.T.astype(np.int64).copy())
        self._scalar = skfem.Basis(mesh, skfem.ElementTetP1(), intorder=1)
        self._vector = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP1()), intorder=1)
        # the unknowns of the vector basis in the order of ours here: all x, all y, all z
        self._from_vector = self._vector.nodal_dofs.ravel()
        quadratic = skfem.Basis(mesh, skfem.ElementTetP1(), intorder=2)
        M = scene.density[0] / scene.time_step**2 * mass.assemble(quadratic)
        self._inertia = skfem.bmat([[M if i == k else None for k in range(3)] for i in range(3)], "csr")
        self._weight = scene.external_force.T.ravel()
        self._free = (np.arange(3)[:, None] * n + scene.free).ravel()

    def step(self, state: FullState, loads: Loads) -> tuple[FullState, Solution]:
        """The state after a step, and Newton's record."""
        predictor = (2 * state.u - state.u_previous).T.ravel()
        springs = [self._spring(grab) for grab in loads.grabs]
        x = state.u.T.ravel().copy()
        value, moving = self._value(x, predictor, springs), self._value(predictor, predictor, springs)
        if moving < value:
            x, value = predictor.copy(), moving
        evaluations = 2
        for iteration in range(100):
            g = self._gradient(x, predictor, springs)
            slope = float(np.linalg.norm(g[self._free]))
            if slope <= self._tolerance * max(float(np.linalg.norm(x)), 1.0):
                done = Solution(value, slope, iteration, evaluations, Reason.CONVERGED)
                return FullState.moving(x.reshape(3, -1).T.copy(), state.u), done
            d = np.zeros_like(x)
            d[self._free] = self._solve(self._hessian(x, springs), -g[self._free])
            step, f = 1.0, self._value(x + d, predictor, springs)
            evaluations += 1
            while step > 1e-8 and not f <= value + 1e-12 * abs(value):
                step /= 2
                evaluations += 1
                f = self._value(x + step * d, predictor, springs)
            x, value = x + step * d, f
        raise RuntimeError("scikit-fem's Newton did not converge")

    def _solve(self, H: csr_matrix, right: Array) -> Array:
        """SciPy's fastest choice for a symmetric matrix; its default order takes many times as long."""
        options = {"SymmetricMode": True}
        factor = splu(H.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        solution: Array = factor.solve(right)
        return solution

    def _deformation(self, x: Array) -> Array:
        """F at the quadrature points, (3, 3, cells, 1)."""
        field = np.empty_like(x)
        field[self._from_vector] = x
        F: Array = grad(self._vector.interpolate(field)) + IDENTITY[:, :, None, None]
        return F

    def _value(self, x: Array, predictor: Array, springs: list[tuple[csr_matrix, Array]]) -> float:
        F = self._deformation(x)
        J = det(F)
        if J.min() <= 0:
            return float("inf")
        density = 0.5 * self._mu * (J ** (-2 / 3) * ddot(F, F) - 3) + 0.5 * self._lam * (J - 1) ** 2
        offset = x - predictor
        value = np.sum(density * self._vector.dx) + 0.5 * offset @ (self._inertia @ offset) - self._weight @ x
        return float(value) + sum(0.5 * float(np.sum((A @ x - target) ** 2)) for A, target in springs)

    def _gradient(self, x: Array, predictor: Array, springs: list[tuple[csr_matrix, Array]]) -> Array:
        F = self._deformation(x)
        J, T = det(F), transpose(inv(F))
        P = self._mu * J ** (-2 / 3) * (F - ddot(F, F) / 3 * T) + self._lam * (J - 1) * J * T
        g: Array = force.assemble(self._vector, P=P)[self._from_vector]
        g += self._inertia @ (x - predictor) - self._weight
        for A, target in springs:
            g += A.T @ (A @ x - target)
        return g

    def _hessian(self, x: Array, springs: list[tuple[csr_matrix, Array]]) -> csr_matrix:
        """Over the free unknowns."""
        C = self._tangent(self._deformation(x))
        blocks = [[block.assemble(self._scalar, C=C[i, :, k].copy()) for k in range(3)] for i in range(3)]
        H = skfem.bmat(blocks, "csr") + self._inertia
        for A, _ in springs:
            H = H + A.T @ A
        free: csr_matrix = H[self._free][:, self._free]
        return free

    def _tangent(self, F: Array) -> Array:
        """∂P_ij/∂F_kl, (3, 3, 3, 3, cells, 1)."""
        J, T, I1 = det(F), transpose(inv(F)), ddot(F, F)
        TT, crossed = np.einsum("ij...,kl...->ijkl...", T, T), np.einsum("il...,kj...->ijkl...", T, T)
        mixed = np.einsum("ij...,kl...->ijkl...", F, T)
        mixed += mixed.transpose(2, 3, 0, 1, 4, 5).copy()
        identity = np.einsum("ik,jl->ijkl", IDENTITY, IDENTITY)[..., None, None]
        shear = identity - 2 / 3 * mixed + 2 / 9 * I1 * TT + I1 / 3 * crossed
        C: Array = self._mu * J ** (-2 / 3) * shear + self._lam * J * ((2 * J - 1) * TT - (J - 1) * crossed)
        return C

    def _spring(self, grab: Grab) -> tuple[csr_matrix, Array]:
        root, count, n = np.sqrt(grab.stiffness), len(grab.vertices), len(self._vertices)
        rows = np.repeat(np.arange(3), count)
        columns = (np.arange(3)[:, None] * n + grab.vertices).ravel()
        A = csr_matrix((np.full(3 * count, root / count), (rows, columns)), shape=(3, 3 * n))
        return A, root * (grab.target - self._vertices[grab.vertices].mean(axis=0))
