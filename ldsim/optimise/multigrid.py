"""Algebraic multigrid for elasticity: smoothed aggregation with rigid-body modes. The only importer of pyamg.

Vaněk, Mandel and Brezina 1996, "Algebraic multigrid by smoothed aggregation for second and fourth order elliptic
problems". Memory grows with the unknowns, not with a factor's fill.
"""

from __future__ import annotations

import numpy as np
from pyamg.aggregation import smoothed_aggregation_solver
from scipy.sparse import bsr_matrix

from ldsim.arrays import Array, Indices

# Relative residuals: what serves a Newton direction, and what serves a preconditioner.
EXACT, LOOSE = 1e-4, 0.1
MAX_CYCLES = 200


class Multigrid:
    """Conjugate gradients with one V-cycle as preconditioner.

    Args:
        indptr, columns: the pattern, compressed rows of blocks, (f + 1,) and (b,).
        blocks: the 3×3 blocks of a symmetric positive definite matrix, (b, 3, 3) float64.
        positions: of the vertices at which the matrix was made, (f, 3) metres; their rigid motions cost little energy.
        exact: solve to a residual that serves Newton instead of one that serves a preconditioner.
    """

    def __init__(self, indptr: Indices, columns: Indices, blocks: Array, positions: Array, exact: bool = False) -> None:
        size = 3 * len(positions)
        matrix = bsr_matrix((blocks, columns.astype(np.int32), indptr.astype(np.int32)), shape=(size, size))
        self._tolerance = EXACT if exact else LOOSE
        # pyamg estimates spectral radii from random vectors; a resumed run has to draw the same ones.
        before = np.random.get_state()
        np.random.seed(0)
        try:
            self._levels = smoothed_aggregation_solver(
                matrix, B=rigid_modes(positions), max_coarse=100, coarse_solver="splu", improve_candidates=None
            )
        finally:
            np.random.set_state(before)

    def solve(self, right: Array) -> Array:
        """x with A x ≈ right, (3f,) float64."""
        x: Array = self._levels.solve(right, tol=self._tolerance, maxiter=MAX_CYCLES, accel="cg")
        return x


def rigid_modes(positions: Array) -> Array:
    """The six rigid motions of points (f, 3) as columns, (3f, 6): three translations, three rotations."""
    x, y, z = (positions - positions.mean(axis=0)).T
    modes = np.zeros((len(positions), 3, 6))
    modes[:, range(3), range(3)] = 1.0
    modes[:, 0, 4], modes[:, 0, 5] = z, -y
    modes[:, 1, 3], modes[:, 1, 5] = -z, x
    modes[:, 2, 3], modes[:, 2, 4] = y, -x
    return modes.reshape(-1, 6)
