"""Reduced elastic forces of poses, point by point, without the matrix of points times poses.

Point s adds b_st = J(z_t)ᵀ Uᵀ (w_s P_s ∇N) ∈ R^r to the reduced force of pose t (An, Kim and James 2008,
"Optimizing Cubature for Efficient Integration of Subspace Deformations", Sec. 4, there with J = I). Its inner product
with a residual ρ needs no b_st: with y_t = U J(z_t) ρ_t it is Σ_t w_s P_s(t) : Σ_a y_a ⊗ ∇N_a, one pass over the
points a pose.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.mechanics.elastic import Elements, add_elastic_gradient, point_stresses
from ldsim.mechanics.scene import Scene
from ldsim.reduction.cubature.kernels import add_point_powers
from ldsim.reduction.cubature.poses import DecodedPoses, Poses, TruePoses
from ldsim.reduction.decoder import Decoder

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

POSES_AT_ONCE = 16
POINTS_AT_ONCE = 64
# Forces below this share of those at a strain of one are rounding errors.
ROUNDING = 1e-13


class ProjectedForces:
    """The normalised reduced forces of T poses: their target, and each point's share of it.

    A pose is u_t = U φ(z_t), or `displacement(t)` where given: the shares of the true poses, projected with the
    decoder's Jacobian at z_t. Each pose is divided by max(‖f_t‖, floor · median ‖f‖), so that neither the most strained
    poses nor those near rest decide alone. Poses of infinite energy are left out.

    Args:
        scene: the solid.
        U: basis, (3n, k) float64.
        decoder: φ: R^r → R^k; `Decoder.identity(k)` for the linear space.
        z: coordinates of the poses, (T, r) float64.
        displacement: true displacement of pose t, (n, 3), metres; called again in every pass.
        floor: smallest scale of a pose, as a share of the median.
        memory: bytes allowed for keeping stresses in float32; poses that do not fit are computed in every pass.

    Raises:
        SolverError: on shapes that do not fit, no pose of finite energy, or no pose with a force.
    """

    def __init__(
        self,
        scene: Scene,
        U: Array,
        decoder: Decoder,
        z: Array,
        displacement: Callable[[int], Array] | None = None,
        floor: float = 0.05,
        memory: int = 2**30,
    ) -> None:
        self._elements: Elements = scene.elements
        self._U = np.ascontiguousarray(U, dtype=np.float64)
        z = np.ascontiguousarray(z, dtype=np.float64)
        _check_shapes(scene, self._U, decoder, z, floor)
        self._poses: Poses = (
            DecodedPoses(self._U, decoder(z))
            if displacement is None
            else TruePoses(displacement, scene.mesh.n_vertices)
        )
        forces, finite = self._total_forces(len(z))
        self.dropped = int((~finite).sum())
        if not finite.any():
            raise SolverError(
                f"cubature: all {len(z)} poses have infinite energy (inverted points); give poses without inversion or "
                "use a material that allows it"
            )
        self._kept = np.flatnonzero(finite)
        self._jacobians = np.stack([decoder.jacobian(row) for row in z[finite]])
        reduced = np.einsum("tkr,tk->tr", self._jacobians, forces[finite])
        self._scales = _pose_scales(np.linalg.norm(reduced, axis=1), floor, ROUNDING * _unit_force(self._elements))
        self.target: Array = (reduced / self._scales[:, None]).ravel()
        self._memory = memory

    @property
    def n_points(self) -> int:
        return len(self._elements.weights)

    @property
    def n_poses(self) -> int:
        """The poses of finite energy, T."""
        return len(self._kept)

    @property
    def point_weights(self) -> Array:
        """Full quadrature weight of each point, (s,) float64, m³."""
        return self._elements.weights

    def columns(self, points: Indices) -> Array:
        """Normalised shares b_st / scale_t of some points with their full weights, (T r, c) float64."""
        elements, vertices = _part(self._elements, np.asarray(points, dtype=np.int64))
        rows = np.ascontiguousarray(self._U.reshape(-1, 3, self._U.shape[1])[vertices])
        stresses = np.empty((self.n_poses, len(elements.weights), 9))
        part_of_pose = self._poses.at(vertices)
        for t, pose in enumerate(self._kept):
            point_stresses(elements, part_of_pose(int(pose)), stresses[t])
        columns = np.empty((*self._jacobians.shape[::2], len(elements.weights)))
        for first in range(0, len(elements.weights), POINTS_AT_ONCE):
            chunk = slice(first, first + POINTS_AT_ONCE)
            columns[:, :, chunk] = self._projected(rows, elements, stresses, chunk)
        columns /= self._scales[:, None, None]
        return columns.reshape(len(self.target), -1)

    def correlations(self, residual: Array) -> Array:
        """Every point's column times a residual (T r,); returns (s,) float64."""
        rho = residual.reshape(self.n_poses, -1) / self._scales[:, None]
        y = np.einsum("tkr,tr->tk", self._jacobians, rho)
        powers = np.zeros(self.n_points)
        stresses = np.empty((self.n_points, 9))
        stored = self._stored_stresses
        for first in range(0, self.n_poses, POSES_AT_ONCE):
            fields = y[first : first + POSES_AT_ONCE] @ self._U.T
            for t, field in enumerate(fields.reshape(len(fields), -1, 3), start=first):
                if t < len(stored):
                    add_point_powers(self._elements, stored[t], field, powers)
                else:
                    point_stresses(self._elements, self._poses.whole(int(self._kept[t])), stresses)
                    add_point_powers(self._elements, stresses, field, powers)
        return powers

    @cached_property
    def _stored_stresses(self) -> NDArray[np.float32]:
        """Stresses of the first poses, as many as memory allows, (≤ T, s, 9) float32, Pa."""
        count = min(self.n_poses, self._memory // (self.n_points * 9 * 4))
        stresses = np.empty((count, self.n_points, 9), dtype=np.float32)
        for t, pose in enumerate(self._kept[:count]):
            point_stresses(self._elements, self._poses.whole(int(pose)), stresses[t])
        return stresses

    def _projected(self, rows: Array, elements: Elements, stresses: Array, chunk: slice) -> Array:
        """b_st of a chunk of points with w_s, (T, r, c): J_tᵀ Σ_a U_aᵀ w_s P_s ∇N_a.

        Args:
            rows: the rows U_a, (v, 3, k).
            stresses: P_s, (T, c, 9).
        """
        gradients = elements.gradients[chunk] * elements.weights[chunk, None, None]
        G = np.einsum("caik,caj->ckij", rows[elements.nodes[chunk]], gradients)
        G = G.reshape(*G.shape[:2], 9)
        outer = G @ stresses[:, chunk].transpose(1, 2, 0)
        projected: Array = self._jacobians.transpose(0, 2, 1) @ outer.transpose(2, 1, 0)
        return projected

    def _total_forces(self, count: int) -> tuple[Array, NDArray[np.bool_]]:
        """Uᵀ f of every pose, (T, k), N, and which poses have finite energy, (T,)."""
        forces = np.zeros((count, self._U.shape[1]))
        finite = np.zeros(count, dtype=bool)
        gradient = np.empty((len(self._U) // 3, 3))
        for t in range(count):
            gradient[:] = 0.0
            finite[t] = np.isfinite(add_elastic_gradient(self._elements, self._poses.whole(t), gradient))
            forces[t] = gradient.ravel() @ self._U
        return forces, finite & np.isfinite(forces).all(axis=1)


def _part(elements: Elements, points: Indices) -> tuple[Elements, Indices]:
    """Some points with their vertices renumbered from 0, and the numbers these vertices had."""
    vertices, nodes = np.unique(elements.nodes[points], return_inverse=True)
    part = Elements(
        nodes.reshape(len(points), -1).astype(np.int32),
        elements.gradients[points],
        elements.weights[points],
        elements.kind[points],
        elements.mu[points],
        elements.lam[points],
    )
    return part, vertices.astype(np.int64)


def _unit_force(elements: Elements) -> float:
    """Norm of the vertex forces Σ_s w_s (2μ + λ) ‖∇N‖ of a strain of one, N."""
    stress = elements.weights * (2 * elements.mu + elements.lam)
    shares = stress[:, None] * np.linalg.norm(elements.gradients, axis=2)
    return float(np.linalg.norm(np.bincount(elements.nodes.ravel(), shares.ravel())))


def _pose_scales(norms: Array, floor: float, rounding: float) -> Array:
    """max(‖f_t‖, floor · median ‖f‖), N; never zero, for rest poses hold rounding errors alone."""
    if not norms.max() > rounding:
        raise SolverError(f"cubature: the elastic force of all {len(norms)} poses is zero; give poses away from rest")
    return np.maximum(norms, max(floor * float(np.median(norms)), rounding))


def _check_shapes(scene: Scene, U: Array, decoder: Decoder, z: Array, floor: float) -> None:
    rows = 3 * scene.mesh.n_vertices
    if U.shape != (rows, decoder.k):
        raise SolverError(f"cubature: basis has shape {U.shape}; this mesh and decoder need ({rows}, {decoder.k})")
    if z.ndim != 2 or z.shape[1] != decoder.r or len(z) == 0:
        raise SolverError(f"cubature: poses have shape {z.shape}; expected (T, {decoder.r}) with T > 0")
    if not 0 < floor <= 1:
        raise SolverError(f"cubature: floor is {floor:g}; allowed is 0 < floor <= 1")
