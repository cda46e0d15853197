"""Tangents and forces of the reduced coordinates at some training poses, for the equilibrium loss of training."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.jit import in_threads
from ldsim.learn.examples import PoseForces
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.space.basis import Basis


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
