"""Tangents and forces of the reduced coordinates at some training poses, for the equilibrium loss of training."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ldsim.jit import in_threads
from ldsim.learn import Forces
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.space.pca import Chunks

Array = NDArray[np.float64]


def spread_frames(total: int, count: int) -> NDArray[np.int64]:
    """At most `count` frames, evenly spread over all."""
    frames: NDArray[np.int64] = np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(np.int64))
    return frames


def pose_forces(
    scene: Scene,
    U: Array,
    q: Array,
    chunks: Chunks,
    frames: NDArray[np.int64],
    progress: Callable[[], object],
    lifted: Callable[[int], Array] | None = None,
) -> Forces:
    """K̃ and the force that projection adds at some of the training snapshots.

    Every quadrature point is integrated; the point tangents are clamped to be positive semidefinite. Poses are shared
    out over the cores.

    Args:
        U: basis, (3n, k). q: coordinates of all snapshots, (N, k). chunks: their displacements, in the same order,
            without what moving pins prescribe.
        frames: which snapshots, (p,) rising.
        progress: called after each of them.
        lifted: what moving pins prescribe in snapshot t, (3n,), metres; None where all stand still.
    """
    n, k = scene.mesh.n_vertices, U.shape[1]
    elements = scene.elements
    pattern = StiffnessPattern(scene.points.nodes, scene.free, n)
    free = np.ascontiguousarray(U.reshape(n, 3, k)[scene.free].reshape(-1, k))

    stiffness, excess = np.empty((len(frames), k, k)), np.empty((len(frames), k))

    def evaluate(number: int, left: Array) -> None:
        given = np.zeros((n, 3)) if lifted is None else lifted(int(frames[number])).reshape(n, 3)
        u, projected = given + left, given + (U @ q[frames[number]]).reshape(n, 3)
        stiffness[number] = free.T @ (pattern.matrix(pattern.stiffness_blocks(elements, u, clamp=True)) @ free)
        added = np.zeros((n, 3))
        add_elastic_gradient(elements, u, added)
        np.negative(added, out=added)
        # A projection that inverts a point has no force; what was added before it stops counts for nothing then.
        inverted = not np.isfinite(add_elastic_gradient(elements, projected, added))
        excess[number] = 0.0 if inverted else U.T @ added.ravel()

    start = 0
    for chunk in chunks():

        def work(number: int, chunk: NDArray[np.float32] = chunk, start: int = start) -> None:
            evaluate(number, chunk[frames[number] - start].reshape(n, 3).astype(np.float64))

        here = np.flatnonzero((frames >= start) & (frames < start + len(chunk)))
        for _ in in_threads(work, here.tolist()):
            progress()
        start += len(chunk)
    return Forces(frames, stiffness, excess)


def spread_forces(
    scene: Scene,
    U: Array,
    q: Array,
    chunks: Chunks,
    rehearsed: Array,
    count: int,
    progress: Callable[[], object],
    lifted: Callable[[int], Array] | None = None,
) -> Forces:
    """`pose_forces` of at most `count` poses, spread evenly over the snapshots and the rehearsed frames after them.

    Args:
        rehearsed: coordinates of poses that are U q themselves, with all pins at rest, (f, k); their rows are those
            from len(q) on.
    """
    n = scene.mesh.n_vertices
    frames = spread_frames(len(q) + len(rehearsed), count)
    own, others = frames[frames < len(q)], frames[frames >= len(q)]
    chosen = rehearsed[others - len(q)]
    poses = ((U @ row).reshape(1, n, 3) for row in chosen)
    recorded = pose_forces(scene, U, q, chunks, own, progress, lifted)
    added = pose_forces(scene, U, chosen, lambda: poses, np.arange(len(others)), progress)
    return Forces(
        frames,
        np.concatenate([recorded.stiffness, added.stiffness]),
        np.concatenate([recorded.excess, added.excess]),
    )
