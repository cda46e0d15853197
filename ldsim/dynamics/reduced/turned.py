"""The springs of grabs in a condensed space: in series with its residual compliance, which turns with the solid.

A spring that pulls at the centroid of some vertices acts in series with C (space/compliance.py), which is known at
rest. Where the solid is held it may have turned by then: what was soft across a rod is soft across it still. So a force
is turned back, C at rest is applied, and what that moves is turned again, C ≈ R C₀ Rᵀ with one rotation a grab, as
warping does to stiffness (Müller et al. 2002, "Stable real-time deformations"). The rotations are those of the state
in which a step begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.reduced.potential import Springs
from ldsim.jit import njit
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.materials.tensors import product_transposed, signed_svd
from ldsim.space.space import Space


class InSeries(NamedTuple):
    """What some grabs have as long as they hold the same vertices.

    B (3g, k) and centre (3g,): c(q) = centre + B q, metres, of all centroids. compliance (3g, 3g): B C Bᵀ at rest, m/N.
    softness (3g,): 1/k. shape (g, 3, 3) + turn (g, 3, 3, k) q: Σ y_v ⊗ d_v of the cells around (`Compliance.arms`), m².
    """

    B: Array
    centre: Array
    compliance: Array
    softness: Array
    shape: Array
    turn: Array

    @classmethod
    def of(cls, space: Space, grabs: Sequence[Grab], gravity: Array | None) -> InSeries:
        """Those of a condensed space under some gravity, the scene's where it is left out."""
        compliance = space.compliance
        assert compliance is not None
        U, rest, held = space.reduced_basis.fields, space.scene.mesh.vertices, [grab.vertices for grab in grabs]
        sunk = rest + compliance.sag(gravity)
        arms = [compliance.arms(vertices) for vertices in held]
        near = [np.flatnonzero(each.any(axis=1)) for each in arms]
        turn = [np.einsum("vik,vj->ijk", U[some], each[some]) for some, each in zip(near, arms, strict=True)]
        return cls(
            np.concatenate([U[vertices].mean(axis=0) for vertices in held]),
            np.concatenate([sunk[vertices].mean(axis=0) for vertices in held]),
            compliance.between(held),
            np.repeat([1 / grab.stiffness for grab in grabs], 3),
            np.stack([rest.T @ each for each in arms]),
            np.stack(turn),
        )


@njit(cache=True, nogil=True)
def turn_springs(series: InSeries, q: Array, targets: Array, rotations: Array, pull: Array, springs: Springs) -> None:
    """Write the springs for a state with coordinates q, (k,), and targets (3g,), metres.

    Their energy ½ pᵀ (diag(1/k) + R B C Bᵀ Rᵀ)⁻¹ p couples all grabs. With the Cholesky factor L of what is inverted it
    is ½ ‖L⁻¹ p‖²: springs of unit stiffness on L⁻¹ B, which the kernel of a step knows.

    Args:
        rotations: R of each grab, (g, 3, 3), written.
        pull: L⁻ᵀ, (3g, 3g), written; with the stretch of the unit springs it gives the forces, N.
    """
    count, k = rotations.shape[0], len(q)
    for g in range(count):
        A = series.shape[g].copy()
        for i in range(3):
            for j in range(3):
                row = series.turn[g, i, j]
                for f in range(k):
                    A[i, j] += row[f] * q[f]
        U, _, V = signed_svd((A[0, 0], A[0, 1], A[0, 2], A[1, 0], A[1, 1], A[1, 2], A[2, 0], A[2, 1], A[2, 2]))
        R = product_transposed(U, V)
        for i in range(3):
            for j in range(3):
                rotations[g, i, j] = R[3 * i + j]
    flexible = np.diag(series.softness)
    for g in range(count):
        for h in range(count):
            block = series.compliance[3 * g : 3 * g + 3, 3 * h : 3 * h + 3].copy()
            flexible[3 * g : 3 * g + 3, 3 * h : 3 * h + 3] += rotations[g] @ block @ rotations[h].T
    inverse = np.linalg.inv(np.linalg.cholesky(0.5 * (flexible + flexible.T)))
    pull[:] = inverse.T
    springs.B[:] = (inverse @ series.B).reshape(springs.B.shape)
    springs.centre[:] = (inverse @ series.centre).reshape(springs.centre.shape)
    springs.target[:] = (inverse @ targets).reshape(springs.target.shape)
