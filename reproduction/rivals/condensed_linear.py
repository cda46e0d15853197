"""The condensed space of linear elasticity: V_eff = ½ zᵀS₀z and u = T₀z, exact for small motions, made without samples.

It is static condensation (Guyan 1965) with the residual compliance (MacNeal 1971): a floor that any condensed space
must beat where motions are large, and a free way to guess where z goes.
"""

from __future__ import annotations

import numpy as np

from ldsim.arrays import Array
from ldsim.cubature.rule import CubatureRule
from ldsim.errors import SolverError
from ldsim.mechanics.materials import material_number
from ldsim.mechanics.scene import Scene
from ldsim.space.basis import Basis, weighted
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.relaxation import Relaxation, Relaxed
from ldsim.space.space import Space

# A field whose square is below this, where V's are 1, is rounding.
NOTHING = 1e-16


def condensed_linear(relaxation: Relaxation) -> Space:
    """The condensed space of a solid's rest.

    Raises:
        SolverError: the solid has fewer quadrature points than there are coordinates, which no real mesh has.
    """
    scene, rest, r = relaxation.scene, relaxation.rest, relaxation.r
    basis, slaved = _basis(scene, relaxation.coordinates, rest)
    weight = np.hstack([np.eye(r), slaved])
    networks = Decoder.network([weight], [np.zeros(weight.shape[1])]), Encoder((np.eye(basis.k, r),), (np.zeros(r),))
    return Space.condensed(scene, basis, networks, _quadratic(scene, rest.stiffness, basis.k))


def _basis(scene: Scene, coordinates: Basis, rest: Relaxed) -> tuple[Basis, Array]:
    """V, beside it an orthonormal basis of T₀ − V, which W takes to zero, and T₀ − V's coordinates there, (r, j)."""
    V, r = coordinates.matrix, coordinates.k
    slaved = np.ascontiguousarray((rest.tangents.reshape(-1, r) - V).T)
    values, vectors = np.linalg.eigh(weighted(scene.mass, slaved) @ slaved.T)
    # where V are vibration modes, T₀ is V and nothing is slaved
    sizes, vectors = np.sqrt(values[values > NOTHING]), vectors[:, values > NOTHING]
    columns = slaved.T @ (vectors / sizes)
    return Basis.of(np.ascontiguousarray(np.hstack([V, columns])), scene.mass), vectors * sizes


def _quadratic(scene: Scene, stiffness: Array, k: int) -> CubatureRule:
    """½ zᵀSz as points of linear elasticity, one sheared along each eigenvector a of S: w μ (a·z)²/2, w μ = 1."""
    r = len(stiffness)
    if scene.points.n_points < r:
        raise SolverError(f"{scene.points.n_points} quadrature points for {r} coordinates; use fewer coordinates")
    values, vectors = np.linalg.eigh(stiffness)
    maps = np.zeros((r, 9, k))
    maps[:, 1, :r] = (vectors * np.sqrt(values)).T
    points = np.arange(r)
    return CubatureRule(points, 1 / scene.elements.mu[points], 0.0, maps, material=material_number("linear"))
