"""The compliance of a condensed space kept at a few vertices, so that a grab needs no factor and no solve.

    C ≈ P A Pᵀ,  A = P⁺ C P⁺ᵀ

P carries a field from a anchors to all vertices, by moving least squares over the nearest ones, which reproduces affine
fields (Lancaster and Salkauskas 1981). A usual grab spreads its force over a tenth of the solid's diagonal, and what so
broad a force moves is smooth on the scale of anchors that lie at half of that. Symmetric and nowhere negative, as C is.
Where there are no more free vertices than anchors, nothing is approximated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from ldsim.arrays import Array, Indices
from ldsim.mechanics.grabs import usual_grip
from ldsim.mechanics.random_pulls import farthest_first, spread_points
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import vertex_graph

ANCHORS, NEAREST = 400, 12
# Grabs that an approximation is judged by.
JUDGED = 24
# Anchors whose solves are done at once, for memory.
BATCH = 20


@dataclass(frozen=True, eq=False)
class Anchors:
    """P and A.

    Attributes:
        near: of each vertex the anchors it hangs on, (n, p) int64.
        weights: and how much on each, (n, p) float64; zero at pins.
        matrix: A, (3a, 3a) float64, m/N.
    """

    near: Indices
    weights: Array
    matrix: Array

    @classmethod
    def of(cls, scene: Scene, residual: Callable[[Array], Array], count: int = ANCHORS) -> Anchors:
        """Those of a solid whose C is given by what it makes of forces (b, n, 3); costs three solves an anchor."""
        _, near, weights = interpolation(scene, count)
        P = interpolator(near, weights).toarray()
        inverse = np.linalg.pinv(P.T @ P, rcond=1e-10, hermitian=True) @ P.T
        matrix = np.empty((len(inverse), 3, len(inverse), 3))
        for start in range(0, len(inverse), BATCH):
            some = inverse[start : start + BATCH]
            loads = np.einsum("an,xy->axny", some, np.eye(3)).reshape(3 * len(some), -1, 3)
            fields = residual(loads).reshape(len(some), 3, -1, 3)
            matrix[start : start + BATCH] = np.einsum("bn,axny->axby", inverse, fields, optimize=True)
        flat = matrix.reshape(3 * len(inverse), -1)
        return cls(near, weights, 0.5 * (flat + flat.T))

    def residual(self, force: Array) -> Array:
        """C f of forces (…, n, 3), N, (…, n, 3) metres."""
        P = interpolator(self.near, self.weights)
        moved = [P @ (self.matrix @ (P.T @ f).ravel()).reshape(-1, 3) for f in force.reshape(-1, *force.shape[-2:])]
        return np.reshape(moved, force.shape)

    def error(
        self, scene: Scene, residual: Callable[[Array], Array], dent: Callable[[Array], Array] | None = None
    ) -> tuple[float, float]:
        """How far the compliance of usual grabs over the surface is off: in the middle and at most, shares of dents."""
        x, shares, radius = scene.mesh.vertices, [], usual_grip(scene)[1]
        for point in spread_points(scene, JUDGED).tolist():
            held = np.flatnonzero((np.linalg.norm(x - x[point], axis=1) <= radius) & scene.movable)
            force = np.zeros((3, *x.shape))
            force[np.arange(3)[:, None], held, np.arange(3)[:, None]] = 1 / len(held)
            exact = residual(force)[:, held].mean(axis=1)
            kept = self.residual(force)[:, held].mean(axis=1)
            whole = exact if dent is None else dent(force)[:, held].mean(axis=1)
            shares.append(float(np.linalg.norm(kept - exact) / np.linalg.norm(whole)))
        return float(np.median(shares)), max(shares)


def interpolation(scene: Scene, count: int) -> tuple[Indices, Indices, Array]:
    """Anchors, (a,), of at most so many vertices spread over a scene, and `Anchors.near` and `weights` for them."""
    free, x = scene.free, scene.mesh.vertices
    if len(free) <= count:
        near = np.zeros((len(x), 1), dtype=np.int64)
        near[free, 0] = np.arange(len(free))
        return free, near, scene.movable[:, None].astype(np.float64)
    chosen = farthest_first(x, count, np.random.default_rng(0))
    apart = _distances(scene, chosen)
    near = np.argsort(apart, axis=0, kind="stable")[:NEAREST].T
    weights = _least_squares(x[chosen][near] - x[:, None], np.take_along_axis(apart.T, near, axis=1))
    weights[scene.pinned] = 0.0
    # pinned anchors count as anchors that do not move, so that fields come to rest towards the pins
    still = scene.pinned[chosen]
    weights[still[near]] = 0.0
    number = np.where(still, 0, np.cumsum(~still) - 1)
    return chosen[~still], number[near], weights


def interpolator(near: Indices, weights: Array) -> csr_array:
    """P, (n, a)."""
    start = np.arange(0, near.size + 1, near.shape[1])
    return csr_array((weights.ravel(), near.ravel(), start), shape=(len(near), int(near.max()) + 1))


def _least_squares(away: Array, distance: Array) -> Array:
    """Weights of anchors that lie `away` (n, p, 3), at a distance through the solid, (n, p); infinite ones get none."""
    beyond = 1.05 * np.where(np.isfinite(distance), distance, 0.0).max(axis=1, keepdims=True) + 1e-300
    share = np.minimum(distance / beyond, 1.0)
    bell = (1 - share) ** 4 * (4 * share + 1)  # Wendland 1995
    affine = np.concatenate([np.ones((*away.shape[:2], 1)), away / beyond[..., None]], axis=2)
    normal = np.einsum("np,npi,npj->nij", bell, affine, affine) + 1e-8 * np.eye(4)
    first = np.linalg.solve(normal, np.eye(4)[:, :1])[..., 0]
    weights: Array = bell * np.einsum("npi,ni->np", affine, first)
    return weights


def _distances(scene: Scene, chosen: Indices) -> Array:
    """From some vertices along edges to all, (a, n) metres; so that what is near across a gap is far."""
    n, x = scene.mesh.n_vertices, scene.mesh.vertices
    edges = vertex_graph(scene.points.nodes, np.arange(n), n).tocoo()
    lengths = np.linalg.norm(x[edges.row] - x[edges.col], axis=1)
    found: Array = dijkstra(csr_array((lengths, (edges.row, edges.col)), shape=(n, n)), indices=chosen)
    return found
