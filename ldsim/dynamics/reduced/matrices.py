"""Mass and rest stiffness seen through a basis, and maps and matrices without what is only zero."""

from __future__ import annotations

import numpy as np

from ldsim.arrays import Array
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.space.basis import Basis


def reduced_mass(scene: Scene, basis: Basis) -> Array:
    """M̃ = UᵀMU, (k, k) float64."""
    U = basis.matrix
    product = np.ascontiguousarray(scene.mass @ U.reshape(scene.mesh.n_vertices, -1)).reshape(U.shape)
    mass: Array = U.T @ product
    return mass


def reduced_rest_stiffness(scene: Scene, basis: Basis) -> Array:
    """K̃₀ = UᵀK₀U, (k, k) float64, N/m in the coordinates of U."""
    pattern = StiffnessPattern(scene.points.nodes, scene.free, scene.mesh.n_vertices)
    rest = np.zeros((scene.mesh.n_vertices, 3))
    matrix = pattern.matrix(pattern.stiffness_blocks(scene.elements, rest, clamp=False))
    free = basis.fields[scene.free].reshape(3 * pattern.n_free, -1)
    stiffness: Array = free.T @ (matrix @ free)
    return 0.5 * (stiffness + stiffness.T)


def leading(maps: Array) -> Array:
    """Strain maps (c, 9, j) of the leading coordinates that they depend on."""
    used = np.flatnonzero(np.abs(maps).max(axis=(0, 1)))
    last = int(used[-1]) + 1 if len(used) else 1
    return maps if last == maps.shape[2] else np.ascontiguousarray(maps[:, :, :last])


def diagonal_or_whole(matrix: Array) -> Array:
    """The diagonal (1, k) of a matrix with nothing else but rounding, or the matrix."""
    diagonal = np.diagonal(matrix)
    if not diagonal.any():
        return np.zeros((1, len(matrix)))
    rest = np.abs(matrix - np.diag(diagonal)).max()
    return np.ascontiguousarray(diagonal[None]) if rest <= 1e-13 * diagonal[diagonal > 0].min() else matrix
