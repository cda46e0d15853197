"""The rows of the least-squares system of cubature: reduced forces, their change along a direction, and energies.

Every kind of row answers the same three questions, and none of them needs its matrix of rows × points.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.forces import ProjectedForces, pose_scales
from ldsim.cubature.kernels import add_point_energies
from ldsim.cubature.part import Part
from ldsim.jit import in_threads
from ldsim.mechanics.elastic import Elements, elastic_energy
from ldsim.mechanics.scene import Scene
from ldsim.space.decoder import Decoder

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FLOOR = 0.05


class Rows(Protocol):
    """Rows A x ≈ A 1 of multipliers x ≥ 0, one a point; all points with their full weights are the exact solution."""

    @property
    def n_points(self) -> int: ...

    @property
    def point_weights(self) -> Array:
        """Full quadrature weight of each point, (s,) float64, m³."""
        ...

    @property
    def target(self) -> Array:
        """A 1, (rows,) float64, dimensionless; aims may differ from it where a closure is asked for."""
        ...

    def columns(self, points: Indices) -> Array:
        """(rows, c) float64."""
        ...

    def correlations(self, residual: Array) -> Array:
        """Aᵀ residual, (s,) float64, zero for points that are no candidates."""
        ...


class ForceChanges:
    """Changes of the reduced force along latent directions, normalised: the tangent stiffness that the minimiser sees.

    Row t is (f(z_t + d_t) − f(z_t − d_t)) / scale_t. f(z) = J(z)ᵀUᵀf(Uφ(z)) is the gradient of the energy in z, and so
    this is its second derivative along d_t, with that of the decoder.

    Args:
        forces: at the T poses z + d followed by the T poses z − d; pairs of which one was left out are left out.
        pairs: T.
    """

    def __init__(self, forces: ProjectedForces, pairs: int) -> None:
        self._forces = forces
        place = np.full(2 * pairs, -1)
        place[forces.kept] = np.arange(forces.n_poses)
        both = (place[:pairs] >= 0) & (place[pairs:] >= 0)
        self._ahead, self._behind = place[:pairs][both], place[pairs:][both]
        self._scales = np.ones(len(self._ahead))
        changes = self._change(forces.target[:, None])
        self._scales = pose_scales(np.linalg.norm(changes.reshape(len(self._ahead), -1), axis=1), FLOOR, 0.0)
        self.target: Array = self._change(forces.target[:, None])[:, 0]

    @property
    def n_points(self) -> int:
        return self._forces.n_points

    @property
    def point_weights(self) -> Array:
        return self._forces.point_weights

    def columns(self, points: Indices) -> Array:
        return self._change(self._forces.columns(points))

    def correlations(self, residual: Array) -> Array:
        rho = residual.reshape(len(self._scales), -1) / self._scales[:, None]
        both = np.zeros((self._forces.n_poses, self._forces.dimension))
        both[self._ahead] += rho
        both[self._behind] -= rho
        return self._forces.correlations((both * self._forces.scales[:, None]).ravel())

    def _change(self, columns: Array) -> Array:
        """Normalised forces (rows, c) → normalised changes."""
        shape = (self._forces.n_poses, self._forces.dimension, columns.shape[1])
        forces = columns.reshape(shape) * self._forces.scales[:, None, None]
        changes: Array = (forces[self._ahead] - forces[self._behind]) / self._scales[:, None, None]
        return changes.reshape(len(self._ahead) * shape[1], shape[2])


class Energies:
    """The elastic energies of poses u_t = U [φ(z_t); a_t], each divided by max(V_t, floor · median V).

    Args:
        given: a_t, as for `ProjectedForces`.
        candidates: the points that `correlations` looks at, (c,); None for all.
    """

    def __init__(
        self,
        scene: Scene,
        U: Array,
        decoder: Decoder,
        z: Array,
        candidates: Indices | None = None,
        threads: int = 1,
        given: Array | None = None,
    ) -> None:
        self._elements: Elements = scene.elements
        self._U, self._threads = U, threads
        self._part = Part.of(scene.elements, U, np.arange(self.n_points) if candidates is None else candidates)
        q = decoder(z) if given is None else np.hstack([decoder(z), given])
        energies = np.array(
            list(in_threads(lambda row: elastic_energy(scene.elements, (U @ row).reshape(-1, 3)), q, threads))
        )
        finite = np.isfinite(energies)
        self._q = q[finite]
        self._scales = pose_scales(energies[finite], FLOOR, 0.0)
        self.target: Array = energies[finite] / self._scales

    @property
    def n_points(self) -> int:
        return len(self._elements.weights)

    @property
    def point_weights(self) -> Array:
        return self._elements.weights

    def columns(self, points: Indices) -> Array:
        part = Part.of(self._elements, self._U, points)
        columns = np.zeros((len(self._q), len(points)))
        for row, q, scale in zip(columns, self._q, self._scales, strict=True):
            add_point_energies(part.elements, part.fields(q[None])[0], 1 / scale, row)
        return columns

    def correlations(self, residual: Array) -> Array:
        part = self._part

        def share(t: int) -> Array:
            energies = np.zeros(len(part.points))
            factor = residual[t] / self._scales[t]
            add_point_energies(part.elements, part.fields(self._q[t : t + 1])[0], factor, energies)
            return energies

        correlations = np.zeros(self.n_points)
        for energies in in_threads(share, range(len(self._q)), self._threads):
            correlations[part.points] += energies
        return correlations
