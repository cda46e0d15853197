"""Modes of a solid whose coordinates are held, which a condensed space may let swing (Craig and Bampton 1968).

A condensed space has all but its coordinates z in equilibrium, and what is in equilibrium has no inertia of its own. Of
a soft solid the slowest of what is beside z has: it lags behind the relaxed pose u₀(z), swings around it, and gives way
to a pull only as fast as its mass lets it. So u = u₀(z) + F δ, with the modes F of K₀ and M among displacements with
W u = 0. Since u₀ is an equilibrium there, δ costs ½ Σ ω² δ² and nothing of first order, at rest exactly.

In a step of length h all of F's part of u, y = Fᵀ M u, is found in closed form from x = Fᵀ M u₀(z):

    y = a x + (1 − a) ŷ + g f,   g = 1 / (ω² + 1/h²),   a = ω² g

with ŷ = 2yₙ − yₙ₋₁ and the forces f on y. What z then sees is ½ Σ a/h² (x − ŷ − h² f)²: stiff modes have the inertia
of the relaxed pose, soft ones none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from ldsim.arrays import Array
from ldsim.space.basis import weighted
from ldsim.space.relaxation import Relaxation

# Relative, of ω².
ACCURACY = 1e-6


class Modes(NamedTuple):
    """F, (n, 3, m), orthonormal in the mass, and ω², (m,) 1/s², ascending.

    turns: whether what they have of a dent turns with the place that is held (dynamics/reduced/warped.py).
    """

    fields: Array
    squares: Array
    turns: bool = False

    def moved(self, force: Array) -> Array:
        """What forces (…, n, 3), N, move of the modes in equilibrium, (…, n, 3) metres."""
        F = self.fields.reshape(-1, len(self.squares))
        found: Array = ((force.reshape(-1, len(F)) @ F) / self.squares) @ F.T
        return found.reshape(force.shape)


def slowest_modes(relaxation: Relaxation, count: int) -> Modes:
    """The slowest modes beside the coordinates of a condensed space, at rest."""
    scene, n = relaxation.scene, relaxation.scene.mesh.n_vertices

    def mass(x: Array) -> Array:
        return np.asarray(weighted(scene.mass, np.ascontiguousarray(x.reshape(1, -1)))).ravel()

    def compliance(f: Array) -> Array:
        return relaxation.residual(f.reshape(n, 3)).ravel()

    M, C = (LinearOperator((3 * n, 3 * n), matvec=each, dtype=np.float64) for each in (mass, compliance))
    start = np.random.default_rng(0).normal(size=3 * n)
    # K is never asked for: its inverse under the constraint is C
    squares, F = eigsh(M, count, M=M, sigma=0.0, OPinv=C, tol=ACCURACY, v0=C @ (M @ start))
    order = np.argsort(squares)
    return Modes(np.ascontiguousarray(F[:, order]).reshape(n, 3, count), squares[order])


def following(squares: Array, rate: float) -> tuple[Array, Array]:
    """a and g of modes; rate is 1/h², or 0 where there is no inertia."""
    gives = 1 / (squares + rate)
    return squares * gives, gives
