"""The reduced forces as equations of the least-squares fit of cubature.

They answer three questions (`Term`), for which no matrix of equations × points is stored. Point s adds
b_st = J(z_t)ᵀ Uᵀ (w_s P_s ∇N) ∈ R^r to the reduced force of pose t (`samples`). Its inner product with a residual ρ
needs no b_st: with y_t = U J(z_t) ρ_t it is Σ_t w_s P_s(t) : Σ_a y_a ⊗ ∇N_a, one pass over the points a pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.cubature.kernels import add_point_powers
from ldsim.cubature.samples import PoseSpace, Samples, Tangents, blocks
from ldsim.jit import in_threads
from ldsim.mechanics.elastic import Elements, elements_at, point_stresses

POINTS_AT_ONCE = 64
# Bytes for keeping stresses in float32; poses that do not fit are computed anew in every pass.
MEMORY = 2**30


class Term(Protocol):
    """Equations A x ≈ b for multipliers x ≥ 0, one a point; x = 1 is every point with its full weight.

    Then A 1 = b: the whole solid is the exact solution, except where a closure moves the target.
    """

    @property
    def point_weights(self) -> Array:
        """Full quadrature weight of each point of the scene, (s,) float64, m³."""
        ...

    @property
    def target(self) -> Array:
        """b, (e,) float64, dimensionless."""
        ...

    def columns(self, points: Indices) -> Array:
        """A at some points, (e, c) float64."""
        ...

    def correlations(self, residual: Array) -> Array:
        """Aᵀ residual, (s,) float64, zero for points that are no candidates."""
        ...


@dataclass(frozen=True, eq=False)
class LocalPoints:
    """Some quadrature points with the basis at their vertices alone, which are renumbered from 0.

    Attributes:
        points: their numbers in the scene, (c,).
        elements: the points themselves.
        nodal: U at their vertices, (v, 3, k).
    """

    points: Indices
    elements: Elements
    nodal: Array

    @classmethod
    def of(cls, elements: Elements, U: Array, points: Indices) -> LocalPoints:
        """Cut out of all elements of a scene."""
        chosen = elements_at(elements, points)
        vertices, nodes = np.unique(chosen.nodes, return_inverse=True)
        local = chosen._replace(nodes=nodes.reshape(chosen.nodes.shape).astype(np.int32))
        return cls(points, local, np.ascontiguousarray(U.reshape(-1, 3, U.shape[1])[vertices]))

    def fields(self, q: Array) -> Array:
        """U q at the vertices for a batch q, (T, k) → (T, v, 3)."""
        return (q @ self.nodal.reshape(-1, self.nodal.shape[2]).T).reshape(len(q), -1, 3)


class ForceTerm:
    """Reduced forces of the samples of finite energy, each divided by its scale (`samples.Tangents`).

    Args:
        space: whose samples these are.
        metric: W (r, r), see `Tangents.of`.
        candidates: the points that `correlations` looks at, (c,); None for all. The target is that of all.

    Raises:
        SolverError: no sample has finite energy, or none a force.
    """

    def __init__(
        self, space: PoseSpace, samples: Samples, metric: Array | None = None, candidates: Indices | None = None
    ) -> None:
        self._elements, self._U, self._threads = space.scene.elements, space.U, space.threads
        self._candidates = candidates
        found = Tangents.of(space, samples, metric)
        # forces on the fields of moving pins count for nothing
        self._projection = np.pad(found.projection, [(0, 0), (0, space.U.shape[1] - space.decoder.k), (0, 0)])
        self._q, self.kept, self.scales = found.q, found.kept, found.scales
        self.target: Array = found.target.ravel()

    @property
    def n_poses(self) -> int:
        """The samples of finite energy, T."""
        return len(self.kept)

    @property
    def dimension(self) -> int:
        """The equations of one sample, r."""
        return int(self._projection.shape[2])

    @property
    def point_weights(self) -> Array:
        return self._elements.weights

    def columns(self, points: Indices) -> Array:
        local = LocalPoints.of(self._elements, self._U, np.asarray(points, dtype=np.int64))
        stresses = np.empty((self.n_poses, len(points), 9))
        self._write_stresses(local, stresses)
        chunks = [slice(first, first + POINTS_AT_ONCE) for first in range(0, len(points), POINTS_AT_ONCE)]
        columns = np.empty((self.n_poses, self.dimension, len(points)))

        def project(chunk: slice) -> None:
            columns[:, :, chunk] = self._projected(local, stresses, chunk)

        for _ in in_threads(project, chunks, self._threads):
            pass
        columns /= self.scales[:, None, None]
        return columns.reshape(len(self.target), len(points))

    def correlations(self, residual: Array) -> Array:
        rho = residual.reshape(self.n_poses, -1) / self.scales[:, None]
        y = np.einsum("tkr,tr->tk", self._projection, rho)
        local, stored = self._local, self._stored_stresses

        def block_powers(block: range) -> Array:
            powers, part = np.zeros(len(local.points)), slice(block.start, block.stop)
            computed = np.empty((len(local.points), 9)) if block[-1] >= len(stored) else None
            poses = local.fields(self._q[part]) if computed is not None else None
            for i, (t, field) in enumerate(zip(block, local.fields(y[part]), strict=True)):
                if t < len(stored):
                    add_point_powers(local.elements, stored[t], field, powers)
                else:
                    assert computed is not None and poses is not None
                    point_stresses(local.elements, poses[i], computed)
                    add_point_powers(local.elements, computed, field, powers)
            return powers

        correlations = np.zeros(len(self.point_weights))
        for powers in in_threads(block_powers, blocks(self.n_poses), self._threads):
            correlations[local.points] += powers
        return correlations

    @cached_property
    def _local(self) -> LocalPoints:
        every = np.arange(len(self.point_weights)) if self._candidates is None else np.unique(self._candidates)
        return LocalPoints.of(self._elements, self._U, every)

    @cached_property
    def _stored_stresses(self) -> NDArray[np.float32]:
        """Candidates' stresses in the first poses, as many as memory allows, (≤ T, c, 9) float32, Pa."""
        points = len(self._local.points)
        count = min(self.n_poses, MEMORY // (points * 9 * 4))
        stresses = np.empty((count, points, 9), dtype=np.float32)
        self._write_stresses(self._local, stresses)
        return stresses

    def _write_stresses(self, local: LocalPoints, stresses: NDArray[np.floating]) -> None:
        """P of some points in the first poses, Pa, into (≤ T, c, 9)."""

        def write(block: range) -> None:
            for t, field in zip(block, local.fields(self._q[block.start : block.stop]), strict=True):
                point_stresses(local.elements, field, stresses[t])

        for _ in in_threads(write, blocks(len(stresses)), self._threads):
            pass

    def _projected(self, local: LocalPoints, stresses: Array, chunk: slice) -> Array:
        """b_st of a chunk of points with w_s, (T, r, c): J_tᵀ Σ_a U_aᵀ w_s P_s ∇N_a; stresses (T, c, 9)."""
        elements = local.elements
        gradients = elements.gradients[chunk] * elements.weights[chunk, None, None]
        G = np.einsum("caik,caj->ckij", local.nodal[elements.nodes[chunk]], gradients)
        G = G.reshape(*G.shape[:2], 9)
        outer = G @ stresses[:, chunk].transpose(1, 2, 0)
        projected: Array = self._projection.transpose(0, 2, 1) @ outer.transpose(2, 1, 0)
        return projected
