"""How the deformation gradient at quadrature points depends on coordinates: linearly, whatever the mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldsim.mechanics.scene import Scene

Array = NDArray[np.float64]


def strain_maps(scene: Scene, U: Array, points: NDArray[np.int64]) -> Array:
    """∂F/∂q of the given points, (c, 9, k) float64, 1/m: G_s = Σ_a U_a ⊗ ∇N_a, F's nine entries row by row."""
    k = U.shape[1]
    nodal = U.reshape(scene.mesh.n_vertices, 3, k)
    maps = np.empty((len(points), 9, k))
    for start in range(0, len(points), 4096):
        part = points[start : start + 4096]
        maps[start : start + 4096] = np.einsum(
            "saik,saj->sijk", nodal[scene.points.nodes[part]], scene.points.gradients[part], optimize=True
        ).reshape(-1, 9, k)
    return maps
