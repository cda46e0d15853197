"""Pins that follow a path, in a space whose basis is zero at the pins: u = U q + L a(t).

Each support S, pinned vertices that move together by X → A X + b, gets a weight w_S over the whole solid: 1 on its own
vertices, 0 on all other pins, harmonic between them. The lifted displacement Σ_S w_S (A_S X + b_S − X), linear blend
skinning with harmonic weights, takes the pins exactly where their paths do; where all of them move together it is that
motion of the whole solid. It is linear in a, the twelve entries of (A − I | b) of every support, so its fields L stand
beside the basis like twelve more columns a support, whose coordinates are given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import cg

from ldsim.arrays import Array, Indices
from ldsim.errors import MotionError, SolverError
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene
from ldsim.space.pca import Chunks

# The entries of (A − I | b) of one support.
ENTRIES = 12


@dataclass(frozen=True, eq=False)
class Lifting:
    """The fields of some supports.

    Attributes:
        fields: L, (3n, 12 S) float64: displacement per entry of (A − I | b), row by row, one support after the other.
        supports: the vertices of each, (v,) int64.
        pinned: of the scene, (n,) bool.
    """

    fields: Array
    supports: tuple[Indices, ...]
    pinned: NDArray[np.bool_]

    @classmethod
    def of(cls, scene: Scene, motions: Iterable[Motion]) -> Lifting:
        """The fields of all supports of some motions; without any, L has no columns and nothing is solved."""
        distinct = {support.vertices.tobytes(): support.vertices for motion in motions for support in motion.supports}
        supports = tuple(distinct.values())
        n, X = scene.mesh.n_vertices, scene.mesh.vertices
        fields = np.zeros((n, 3, len(supports), 3, 4))
        if supports:
            affine = np.hstack([X, np.ones((n, 1))])
            for i, weight in enumerate(harmonic_weights(scene, supports)):
                for axis in range(3):
                    fields[:, axis, i, axis] = weight[:, None] * affine
        return cls(fields.reshape(3 * n, ENTRIES * len(supports)), supports, scene.pinned)

    @property
    def count(self) -> int:
        """The columns of L, l."""
        return int(self.fields.shape[1])

    def at(self, pins: Iterable[MovedPins]) -> Array:
        """a where these pins were moved, (l,) float64; zero for all others.

        Raises:
            MotionError: pins were moved that this lifting does not know.
        """
        a = np.zeros((len(self.supports), 3, 4))
        for moved in pins:
            a[self._number(moved.vertices)] = moved.map - np.eye(3, 4)
        return a.ravel()

    def coordinates(self, motion: Motion) -> Array:
        """a in every frame of a motion, (N, l) float64; see `at`."""
        a = np.zeros((motion.frames, len(self.supports), 3, 4))
        for support in motion.supports:
            a[:, self._number(support.vertices)] = support.maps[: motion.frames] - np.eye(3, 4)
        return a.reshape(motion.frames, self.count)

    def field(self, a: Array) -> Array:
        """L a, (n, 3) float64, metres."""
        return (a[None] @ self.fields.T).reshape(-1, 3)

    def all_coordinates(self, motions: Sequence[Motion]) -> Array:
        """a of some motions one after the other, (N, l)."""
        return np.concatenate([np.empty((0, self.count)), *(self.coordinates(motion) for motion in motions)])

    def _number(self, moved: Indices) -> int:
        for i, vertices in enumerate(self.supports):
            if moved is vertices or np.array_equal(vertices, moved):
                return i
        raise MotionError(
            f"{len(moved)} pins move, the first at vertex {moved[0]}; this space was not prepared for them"
        )

    def displacements(self, motion: Motion) -> Callable[[int, int], Array]:
        """The function (start, stop) → L a in frames start … stop − 1 of a motion, (frames, n, 3) float64, metres."""
        a = self.coordinates(motion)
        return lambda start, stop: (a[start:stop] @ self.fields.T).reshape(stop - start, -1, 3)

    def taken_off(self, chunks: Chunks, motions: Sequence[Motion]) -> Chunks:
        """Rows u − L a, of the snapshots of some motions one after the other; zero at every pin."""
        if self.count == 0:
            return chunks
        a = self.all_coordinates(motions)

        def relative() -> Iterator[NDArray[np.float32]]:
            start = 0
            for chunk in chunks():
                rows = chunk - (a[start : start + len(chunk)] @ self.fields.T)
                rows.reshape(len(chunk), -1, 3)[:, self.pinned] = 0.0
                yield rows.astype(np.float32)
                start += len(chunk)

        return relative


def harmonic_weights(scene: Scene, supports: Sequence[Indices]) -> list[Array]:
    """For each support ∇²w = 0 with w = 1 at its vertices and 0 at all other pins, (n,) float64 each.

    Raises:
        SolverError: conjugate gradients do not get there.
    """
    K, free = _laplacian(scene), scene.free
    inner, diagonal = K[free][:, free], diags_array(1 / K.diagonal()[free])
    weights = []
    for vertices in supports:
        w = np.zeros(scene.mesh.n_vertices)
        w[vertices] = 1.0
        w[free], failed = cg(inner, -(K @ w)[free], rtol=1e-12, M=diagonal)
        if failed:
            raise SolverError("the weights of pins that move could not be found; check the mesh for flat cells")
        weights.append(w)
    return weights


def _laplacian(scene: Scene) -> csr_array:
    """∫ ∇N_a · ∇N_b dX, (n, n), m."""
    points = scene.points
    blocks = np.einsum("s,sai,sbi->sab", points.weights, points.gradients, points.gradients)
    rows = np.broadcast_to(points.nodes[:, :, None], blocks.shape)
    columns = np.broadcast_to(points.nodes[:, None, :], blocks.shape)
    n = scene.mesh.n_vertices
    return coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsr()
