"""The same implicit Euler step with scikit-fem's assembly and SciPy's solver: Newton, line search, same stop rule."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu
from skfem.helpers import ddot, det, grad, inv, mul, transpose

from ldsim.mechanics.motion import Grab
from ldsim.mechanics.scene import Scene

Array = NDArray[np.float64]


class ScikitFemStepper:
    """Newton steps of the paper's neo-Hookean solid, uniform material, on tets; written as scikit-fem's users do."""

    def __init__(self, scene: Scene, tolerance: float) -> None:
        self._scene, self._tolerance = scene, tolerance
        mesh = skfem.MeshTet(scene.mesh.vertices.T.copy(), scene.mesh.cells.T.astype(np.int64).copy())
        self._basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP1()), intorder=1)
        self._order = self._basis.nodal_dofs.T.ravel()
        mass = skfem.BilinearForm(lambda u, v, w: scene.density[0] * ddot_vector(u, v))
        basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP1()), intorder=2)
        self._inertia = mass.assemble(basis) / scene.time_step**2
        self._weight = self._ours_to_theirs(scene.external_force)
        self._free = np.setdiff1d(np.arange(self._basis.N), self._basis.nodal_dofs[:, scene.pinned])
        mu, lam = scene.mu[0], scene.lam[0]

        def strain(w: skfem.assembly.form.form.FormExtraParams) -> tuple[Array, Array, Array]:
            F = grad(w["u"]) + np.eye(3)[:, :, None, None]
            return F, det(F), transpose(inv(F))

        @skfem.Functional
        def energy(w):  # type: ignore[no-untyped-def]
            F, J, _ = strain(w)
            return 0.5 * mu * (J ** (-2 / 3) * ddot(F, F) - 3) + 0.5 * lam * (J - 1) ** 2

        @skfem.LinearForm
        def force(v, w):  # type: ignore[no-untyped-def]
            F, J, T = strain(w)
            return ddot(mu * J ** (-2 / 3) * (F - ddot(F, F) / 3 * T) + lam * (J - 1) * J * T, grad(v))

        @skfem.BilinearForm
        def stiffness(u, v, w):  # type: ignore[no-untyped-def]
            F, J, T = strain(w)
            dF, I1 = grad(u), ddot(F, F)
            t, turned = ddot(T, dF), mul(T, mul(transpose(dF), T))
            shear = -2 / 3 * t * (F - I1 / 3 * T) + dF - 2 / 3 * ddot(F, dF) * T + I1 / 3 * turned
            dP = mu * J ** (-2 / 3) * shear + lam * J * ((2 * J - 1) * t * T - (J - 1) * turned)
            return ddot(dP, grad(v))

        self._energy, self._force, self._stiffness = energy, force, stiffness

    def _ours_to_theirs(self, u: Array) -> Array:
        x = np.empty(self._basis.N)
        x[self._order] = u.ravel()
        return x

    def step(self, u: Array, u_previous: Array, grabs: Sequence[Grab]) -> tuple[Array, int]:
        """The displacement after a step from (n, 3) metres, and Newton's iterations."""
        predictor = self._ours_to_theirs(2 * u - u_previous)
        springs = [self._spring(grab) for grab in grabs]
        x = self._ours_to_theirs(u)
        x_moving = predictor.copy()
        if self._value(x_moving, predictor, springs) < self._value(x, predictor, springs):
            x = x_moving
        for iteration in range(100):
            fields = {"u": self._basis.interpolate(x)}
            g = self._force.assemble(self._basis, **fields) + self._inertia @ (x - predictor) - self._weight
            for A, target in springs:
                g += A.T @ (A @ x - target)
            norm = np.linalg.norm(g[self._free])
            if norm <= self._tolerance * max(np.linalg.norm(x), 1.0):
                return x[self._order].reshape(-1, 3), iteration
            H = self._stiffness.assemble(self._basis, **fields) + self._inertia
            for A, _ in springs:
                H = H + A.T @ A
            d = np.zeros_like(x)
            # SciPy's fastest choice for a symmetric matrix; its default order takes many times as long
            options = {"SymmetricMode": True}
            factor = splu(
                H[self._free][:, self._free].tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
            )
            d[self._free] = factor.solve(-g[self._free])
            value, step = self._value(x, predictor, springs), 1.0
            while step > 1e-8 and not self._value(x + step * d, predictor, springs) <= value + 1e-12 * abs(value):
                step /= 2
            x = x + step * d
        raise RuntimeError("scikit-fem's Newton did not converge")

    def _value(self, x: Array, predictor: Array, springs: list[tuple[csr_matrix, Array]]) -> float:
        field = self._basis.interpolate(x)
        F = grad(field) + np.eye(3)[:, :, None, None]
        if det(F).min() <= 0:
            return float("inf")
        offset = x - predictor
        value = float(self._energy.assemble(self._basis, u=field)) + 0.5 * offset @ (self._inertia @ offset)
        value -= self._weight @ x
        return value + sum(0.5 * float(np.sum((A @ x - target) ** 2)) for A, target in springs)

    def _spring(self, grab: Grab) -> tuple[csr_matrix, Array]:
        root, count = np.sqrt(grab.stiffness), len(grab.vertices)
        rows = np.repeat(np.arange(3), count)
        columns = self._basis.nodal_dofs[:, grab.vertices].ravel()
        A = csr_matrix((np.full(3 * count, root / count), (rows, columns)), shape=(3, self._basis.N))
        rest = self._scene.mesh.vertices[grab.vertices].mean(axis=0)
        return A, root * (grab.target - rest)


def ddot_vector(u: Array, v: Array) -> Array:
    """u · v of vector fields at quadrature points."""
    product: Array = np.einsum("i...,i...->...", u, v)
    return product
