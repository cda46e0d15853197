"""Reduced elastic forces of poses, point by point, without the matrix of points times poses.

Point s adds b_st = J(z_t)ᵀ Uᵀ (w_s P_s ∇N) ∈ R^r to the reduced force of pose t (An, Kim and James 2008,
"Optimizing Cubature for Efficient Integration of Subspace Deformations", Sec. 4, there with J = I; on the tangent of a
nonlinear manifold Jain and Tiso 2017, "Hyper-reduction over nonlinear manifolds for large nonlinear mechanical
systems", arXiv:1710.05160). Its inner product with a residual ρ needs no b_st: with
y_t = U J(z_t) ρ_t it is Σ_t w_s P_s(t) : Σ_a y_a ⊗ ∇N_a, one pass over the points a pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.kernels import add_point_powers
from ldsim.cubature.part import Part
from ldsim.errors import SolverError
from ldsim.jit import in_threads
from ldsim.mechanics.elastic import Elements, add_elastic_gradient, point_stresses
from ldsim.mechanics.scene import Scene
from ldsim.space.decoder import Decoder

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

POSES_AT_ONCE = 16
POINTS_AT_ONCE = 64
# Forces below this share of those at a strain of one are rounding errors.
ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Closure:
    """A target between the forces of the decoded poses and those of the true ones.

    Attributes:
        displacement: the true displacement of pose t, (n, 3), metres.
        poses: how many there are; poses from this number on keep the forces of their decoded selves.
        share: of the true force in the target, 0 … 1. As the shares of the points stay those of the decoded poses, it
            is the same as fitting both targets with the weights `share` and 1 − `share`.

    Raises:
        SolverError: on a share outside 0 … 1.
    """

    displacement: Callable[[int], NDArray[np.floating]]
    poses: int
    share: float

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise SolverError(
                f"cubature: closure share is {self.share:g}; allowed is 0 (decoded poses) … 1 (true poses)"
            )


class ProjectedForces:
    """The normalised reduced forces of T poses u_t = U [φ(z_t); a_t]: their target, and each point's share of it.

    Each pose is divided by max(‖f_t‖, floor · median ‖f‖), so that neither the most strained poses nor those near rest
    decide alone. Poses of infinite energy are left out.

    Args:
        scene: the solid.
        U: basis, (3n, k) float64; with `given`, the fields L of moving pins beside it, (3n, k + l).
        decoder: φ: R^r → R^k; `Decoder.identity(k)` for the linear space.
        given: a_t, what moving pins prescribe in every pose, (T, l); forces on L count for nothing.
        z: coordinates of the poses, (T, r) float64.
        metric: W (r, r): forces are measured as ‖Wᵀ Jᵀ Uᵀ f‖ (`metric.rest_compliance`); None for ‖Jᵀ Uᵀ f‖.
        closure: aims at the forces of true poses, in part or wholly; None for those of the decoded ones.
        candidates: the points that `correlations` looks at, (c,); None for all. The target is always that of all.
        floor: smallest scale of a pose, as a share of the median.
        memory: bytes allowed for keeping stresses in float32; poses that do not fit are computed in every pass.
        threads: that share out the poses, 0 for one a core. The result does not depend on it.

    Raises:
        SolverError: on shapes that do not fit, no pose of finite energy, or no pose with a force.
    """

    def __init__(
        self,
        scene: Scene,
        U: Array,
        decoder: Decoder,
        z: Array,
        *,
        given: Array | None = None,
        metric: Array | None = None,
        closure: Closure | None = None,
        candidates: Indices | None = None,
        floor: float = 0.05,
        memory: int = 2**30,
        threads: int = 1,
    ) -> None:
        self._elements: Elements = scene.elements
        self._U = np.ascontiguousarray(U, dtype=np.float64)
        self._memory, self._threads, self._candidates = memory, threads, candidates
        z = np.ascontiguousarray(z, dtype=np.float64)
        given = np.empty((len(z), 0)) if given is None else given
        _check_shapes(scene, self._U, decoder, z, given, floor)
        q = np.hstack([decoder(z), given])
        forces, finite = total_forces(
            self._elements, self._U, lambda poses: q[_span(poses)] @ self._U.T, len(q), threads
        )
        if closure is not None:
            true = _checked(closure, scene.mesh.n_vertices)
            aimed, possible = total_forces(self._elements, self._U, true, min(closure.poses, len(q)), threads)
            forces[: len(aimed)] += closure.share * (aimed - forces[: len(aimed)])
            finite[: len(aimed)] &= possible
        if not finite.any():
            raise SolverError(
                f"cubature: all {len(z)} poses have infinite energy (inverted points); give poses without inversion or "
                "use a material that allows it"
            )
        self.kept: Indices = np.flatnonzero(finite)
        self.dropped = len(z) - len(self.kept)
        self._q = q[finite]
        self._jacobians = np.stack([decoder.jacobian(row) for row in z[finite]])
        self._jacobians = np.pad(self._jacobians, [(0, 0), (0, given.shape[1]), (0, 0)])
        if metric is not None:
            self._jacobians = self._jacobians @ metric
        reduced = np.einsum("tkr,tk->tr", self._jacobians, forces[finite])
        largest = 1.0 if metric is None else float(np.linalg.norm(metric, 2))
        rounding = ROUNDING * largest * _unit_force(self._elements)
        self.scales = pose_scales(np.linalg.norm(reduced, axis=1), floor, rounding)
        self.target: Array = (reduced / self.scales[:, None]).ravel()

    @property
    def n_points(self) -> int:
        return len(self._elements.weights)

    @property
    def n_poses(self) -> int:
        """The poses of finite energy, T."""
        return len(self.kept)

    @property
    def dimension(self) -> int:
        """The rows of one pose, r."""
        return int(self._jacobians.shape[2])

    @property
    def point_weights(self) -> Array:
        """Full quadrature weight of each point, (s,) float64, m³."""
        return self._elements.weights

    def columns(self, points: Indices) -> Array:
        """Normalised shares b_st / scale_t of some points with their full weights, (T r, c) float64."""
        part = Part.of(self._elements, self._U, np.asarray(points, dtype=np.int64))
        stresses = np.empty((self.n_poses, len(part.points), 9))
        for block in _blocks(self.n_poses):
            for t, field in zip(block, part.fields(self._q[_span(block)]), strict=True):
                point_stresses(part.elements, field, stresses[t])
        chunks = [slice(first, first + POINTS_AT_ONCE) for first in range(0, len(part.points), POINTS_AT_ONCE)]
        columns = np.empty((*self._jacobians.shape[::2], len(part.points)))

        def project(chunk: slice) -> None:
            columns[:, :, chunk] = self._projected(part, stresses, chunk)

        for _ in in_threads(project, chunks, self._threads):
            pass
        columns /= self.scales[:, None, None]
        return columns.reshape(len(self.target), len(part.points))

    def correlations(self, residual: Array) -> Array:
        """The candidates' columns times a residual (T r,), and zero for all other points; returns (s,) float64."""
        rho = residual.reshape(self.n_poses, -1) / self.scales[:, None]
        y = np.einsum("tkr,tr->tk", self._jacobians, rho)
        part, stored = self._part, self._stored_stresses

        def block_powers(block: range) -> Array:
            powers = np.zeros(len(part.points))
            computed = np.empty((len(part.points), 9)) if block[-1] >= len(stored) else None
            poses = part.fields(self._q[_span(block)]) if computed is not None else None
            for i, (t, field) in enumerate(zip(block, part.fields(y[_span(block)]), strict=True)):
                if t < len(stored):
                    add_point_powers(part.elements, stored[t], field, powers)
                else:
                    assert computed is not None and poses is not None
                    point_stresses(part.elements, poses[i], computed)
                    add_point_powers(part.elements, computed, field, powers)
            return powers

        correlations = np.zeros(self.n_points)
        for powers in in_threads(block_powers, _blocks(self.n_poses), self._threads):
            correlations[part.points] += powers
        return correlations

    @cached_property
    def _part(self) -> Part:
        every = np.arange(self.n_points) if self._candidates is None else np.unique(self._candidates)
        return Part.of(self._elements, self._U, every)

    @cached_property
    def _stored_stresses(self) -> NDArray[np.float32]:
        """Candidates' stresses in the first poses, as many as memory allows, (≤ T, c, 9) float32, Pa."""
        part = self._part
        count = min(self.n_poses, self._memory // (len(part.points) * 9 * 4))
        stresses = np.empty((count, len(part.points), 9), dtype=np.float32)

        def store(block: range) -> None:
            for t, field in zip(block, part.fields(self._q[_span(block)]), strict=True):
                point_stresses(part.elements, field, stresses[t])

        for _ in in_threads(store, _blocks(count), self._threads):
            pass
        return stresses

    def _projected(self, part: Part, stresses: Array, chunk: slice) -> Array:
        """b_st of a chunk of points with w_s, (T, r, c): J_tᵀ Σ_a U_aᵀ w_s P_s ∇N_a; stresses (T, c, 9)."""
        elements = part.elements
        gradients = elements.gradients[chunk] * elements.weights[chunk, None, None]
        G = np.einsum("caik,caj->ckij", part.rows[elements.nodes[chunk]], gradients)
        G = G.reshape(*G.shape[:2], 9)
        outer = G @ stresses[:, chunk].transpose(1, 2, 0)
        projected: Array = self._jacobians.transpose(0, 2, 1) @ outer.transpose(2, 1, 0)
        return projected


def total_forces(
    elements: Elements, U: Array, displacements: Callable[[range], Array], count: int, threads: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Uᵀ f of the poses 0 … count − 1, (T, k), N, and which have finite energy, (T,).

    Args:
        displacements: of a block of poses, (b, 3n) float64, metres.
        threads: that share them out, 0 for one a core. The result does not depend on it.
    """

    def forces(block: range) -> tuple[Array, list[bool]]:
        u = displacements(block).reshape(len(block), -1, 3)
        gradients = np.zeros(u.shape)
        energies = [add_elastic_gradient(elements, *pair) for pair in zip(u, gradients, strict=True)]
        return gradients.reshape(len(block), -1) @ U, [math.isfinite(energy) for energy in energies]

    found = list(in_threads(forces, _blocks(count), threads))
    projected = np.concatenate([part for part, _ in found]) if found else np.empty((0, U.shape[1]))
    finite = np.array([one for _, part in found for one in part], dtype=bool)
    return projected, finite & np.isfinite(projected).all(axis=1)


def pose_scales(norms: Array, floor: float, rounding: float) -> Array:
    """max(‖f_t‖, floor · median ‖f‖), N; never zero, for rest poses hold rounding errors alone.

    Raises:
        SolverError: no norm is above `rounding`.
    """
    if not norms.max() > rounding:
        raise SolverError(f"cubature: the elastic force of all {len(norms)} poses is zero; give poses away from rest")
    return np.maximum(norms, max(floor * float(np.median(norms)), rounding))


def _blocks(count: int) -> list[range]:
    """Poses in blocks that do not depend on the number of threads, and so neither do sums over them."""
    return [range(first, min(first + POSES_AT_ONCE, count)) for first in range(0, count, POSES_AT_ONCE)]


def _span(block: range) -> slice:
    return slice(block.start, block.stop)


def _checked(closure: Closure, n_vertices: int) -> Callable[[range], Array]:
    """The true displacements, each reading checked, for the compiled loops do not."""

    def displacement(t: int) -> Array:
        u = np.ascontiguousarray(closure.displacement(t), dtype=np.float64)
        if u.shape != (n_vertices, 3):
            raise SolverError(f"cubature: displacement of pose {t} has shape {u.shape}; expected ({n_vertices}, 3)")
        return u

    return lambda block: np.stack([displacement(t) for t in block])


def _unit_force(elements: Elements) -> float:
    """Norm of the vertex forces Σ_s w_s (2μ + λ) ‖∇N‖ of a strain of one, N."""
    stress = elements.weights * (2 * elements.mu + elements.lam)
    shares = stress[:, None] * np.linalg.norm(elements.gradients, axis=2)
    return float(np.linalg.norm(np.bincount(elements.nodes.ravel(), shares.ravel())))


def _check_shapes(scene: Scene, U: Array, decoder: Decoder, z: Array, given: Array, floor: float) -> None:
    rows, columns = 3 * scene.mesh.n_vertices, decoder.k + given.shape[1]
    if U.shape != (rows, columns):
        raise SolverError(f"cubature: basis has shape {U.shape}; this mesh and decoder need ({rows}, {columns})")
    if z.ndim != 2 or z.shape[1] != decoder.r or len(z) == 0:
        raise SolverError(f"cubature: poses have shape {z.shape}; expected (T, {decoder.r}) with T > 0")
    if not 0 < floor <= 1:
        raise SolverError(f"cubature: floor is {floor:g}; allowed is 0 < floor <= 1")
