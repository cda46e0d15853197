"""Tangents and forces of the reduced coordinates at some training poses, for the equilibrium loss of training."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.jit import in_threads
from ldsim.learn.examples import PoseForces
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.space.basis import Basis

Array = NDArray[np.float64]
Tell = Callable[[], object]


@dataclass(frozen=True, eq=False)
class Poses:
    """Displacements of a solid, streamed, and their coordinates.

    Attributes:
        q: (N, k).
        chunks: the displacements in the same order, without what moving pins prescribe.
        lifted: what these prescribe in pose t, (3n,), metres; None where all stand still.
    """

    q: Array
    chunks: Callable[[], Iterable[NDArray[np.floating]]]
    lifted: Callable[[int], Array] | None = None


def spread_frames(total: int, count: int) -> NDArray[np.int64]:
    """At most `count` frames, evenly spread over all."""
    frames: NDArray[np.int64] = np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(np.int64))
    return frames


def pose_forces(scene: Scene, basis: Basis, poses: Poses, frames: NDArray[np.int64], tell: Tell) -> PoseForces:
    """K̃ and the force that projection adds, at some of the poses.

    Every quadrature point is integrated; the point tangents are clamped to be positive semidefinite. Poses are shared
    out over the cores.

    Args:
        frames: which of the poses, (p,) rising.
        tell: called after each of them.
    """
    n, k = scene.mesh.n_vertices, basis.k
    pattern = StiffnessPattern(scene.points.nodes, scene.free, n)
    free = np.ascontiguousarray(basis.fields[scene.free].reshape(-1, k))
    stiffness, excess = np.empty((len(frames), k, k)), np.empty((len(frames), k))

    def evaluate(number: int, relative: Array) -> None:
        frame = int(frames[number])
        prescribed = np.zeros((n, 3)) if poses.lifted is None else poses.lifted(frame).reshape(n, 3)
        u, projected = prescribed + relative, prescribed + basis.displacement(poses.q[frame])
        blocks = pattern.stiffness_blocks(scene.elements, u, clamp=True)
        stiffness[number] = free.T @ (pattern.matrix(blocks) @ free)
        added = np.zeros((n, 3))
        add_elastic_gradient(scene.elements, u, added)
        np.negative(added, out=added)
        # A projection that inverts a point has no force; what was added before it stops counts for nothing then.
        inverted = not np.isfinite(add_elastic_gradient(scene.elements, projected, added))
        excess[number] = 0.0 if inverted else basis.matrix.T @ added.ravel()

    start = 0
    for chunk in poses.chunks():

        def work(number: int, chunk: NDArray[np.floating] = chunk, start: int = start) -> None:
            evaluate(number, chunk[frames[number] - start].reshape(n, 3).astype(np.float64))

        here = np.flatnonzero((frames >= start) & (frames < start + len(chunk)))
        for _ in in_threads(work, here.tolist()):
            tell()
        start += len(chunk)
    return PoseForces(frames, stiffness, excess)


def spread_forces(scene: Scene, basis: Basis, poses: Poses, synthetic: Array, count: int, tell: Tell) -> PoseForces:
    """`pose_forces` of at most `count` poses, spread evenly over the snapshots and the synthetic frames after them.

    Args:
        synthetic: coordinates of poses that are U q themselves, with all pins at rest, (f, k); they are numbered from
            len(poses.q) on.
    """
    frames = spread_frames(len(poses.q) + len(synthetic), count)
    own, others = frames[frames < len(poses.q)], frames[frames >= len(poses.q)]
    chosen = synthetic[others - len(poses.q)]
    made = Poses(chosen, lambda: (basis.displacement(q)[None] for q in chosen))
    found = (
        pose_forces(scene, basis, poses, own, tell),
        pose_forces(scene, basis, made, np.arange(len(others)), tell),
    )
    return PoseForces(
        frames,
        np.concatenate([forces.stiffness for forces in found]),
        np.concatenate([forces.excess for forces in found]),
    )
