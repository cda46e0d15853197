"""What an autoencoder learns from: coordinates of frames, and tangents and forces at some of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.jit import in_threads
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.space.basis import Basis


@dataclass(frozen=True, eq=False)
class PoseForces:
    """Tangents and forces at some of the training poses, for the equilibrium loss.

    Attributes:
        frames: which of the examples they belong to, (p,) int64.
        stiffness: UᵀK(u)U at the true poses u, (p, k, k) float64, N/m in the coordinates of U.
        excess: Uᵀ(f(UUᵀMu) − f(u)), what projection alone adds to the internal force, (p, k) float64.
    """

    frames: Indices
    stiffness: Array
    excess: Array


@dataclass(frozen=True, eq=False)
class Examples:
    """Frames to learn from, recorded ones first, then those of synthetic motions.

    Attributes:
        q: their coordinates, (N, k) float64.
        synthetic: how many of them, at the end, are of synthetic motions.
        forces: at some of them; needed where the loss has an equilibrium term.
    """

    q: Array
    synthetic: int = 0
    forces: PoseForces | None = None

    @property
    def recorded(self) -> int:
        """How many are of recordings."""
        return len(self.q) - self.synthetic


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of a solid, looked up one by one, from any thread.

    Attributes:
        q: their coordinates, (N, k).
        displacement: number of a pose → u, (n, 3) float64, metres.
        prescribed: number of a pose → what moving pins prescribe of it, (n, 3), metres.
    """

    q: Array
    displacement: Callable[[int], Array]
    prescribed: Callable[[int], Array]


def spread_numbers(total: int, count: int) -> Indices:
    """At most `count` of the numbers below `total`, evenly spread, rising."""
    return np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(np.int64))


def pose_forces(scene: Scene, basis: Basis, poses: Poses, count: int, tell: Callable[[], object]) -> PoseForces:
    """K̃ and the force that projection adds, at at most `count` poses, spread evenly over all.

    Every quadrature point is integrated; the point tangents are clamped to be positive semidefinite. Poses are shared
    out over the cores.

    Args:
        tell: called after each of them.
    """
    pattern = StiffnessPattern(scene.points.nodes, scene.free, scene.mesh.n_vertices)
    free = np.ascontiguousarray(basis.fields[scene.free].reshape(-1, basis.k))

    def evaluate(number: int) -> tuple[Array, Array]:
        u = poses.displacement(number)
        blocks = pattern.stiffness_blocks(scene.elements, u, clamp=True)
        stiffness = free.T @ (pattern.matrix(blocks) @ free)
        added = np.zeros_like(u)
        add_elastic_gradient(scene.elements, u, added)
        np.negative(added, out=added)
        projected = poses.prescribed(number) + basis.displacement(poses.q[number])
        # A projection that inverts a point has no force; what was added before it stops counts for nothing then.
        inverted = not np.isfinite(add_elastic_gradient(scene.elements, projected, added))
        return stiffness, np.zeros(basis.k) if inverted else basis.matrix.T @ added.ravel()

    numbers = spread_numbers(len(poses.q), count)
    stiffness, excess = np.empty((len(numbers), basis.k, basis.k)), np.empty((len(numbers), basis.k))
    for i, found in enumerate(in_threads(evaluate, numbers.tolist())):
        stiffness[i], excess[i] = found
        tell()
    return PoseForces(numbers, stiffness, excess)
