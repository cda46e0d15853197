"""What should the coordinates of a condensed space be: PCA of the training motions, or the solid's slowest modes?

Of each, r columns are V: z = VᵀMu. How far the frames of a role are from the relaxed poses of their coordinates, with
what loads move beside them, is what r coordinates lose however well the rest is learned (`pipeline.coordinates`). Needs
a run with snapshots and basis; nothing is trained.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import eye_array, kron
from scipy.sparse.linalg import eigsh

from ldsim.arrays import Array
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.pipeline.coordinates import frames_of, slaving
from ldsim.run import Run
from ldsim.space.basis import Basis
from ldsim.space.compliance import Compliance
from reproduction.harness import Row, over_runs, row

NAME = "coordinates"
SIZES = (4, 8, 12, 16)
Frames = Sequence[tuple[Array, Loads]]
ROOMS = [f"ldsim/{room}" for room in ("mechanics", "space", "pipeline")]


def modes(scene: Scene, count: int) -> Basis:
    """The slowest modes of linear elasticity at rest, K φ = ω² M φ."""
    pattern = StiffnessPattern(scene.points.nodes, scene.free, scene.mesh.n_vertices)
    rest = np.zeros((scene.mesh.n_vertices, 3))
    K = pattern.matrix(pattern.stiffness_blocks(scene.elements, rest, clamp=False))
    M = kron(scene.mass[scene.free][:, scene.free], eye_array(3), format="csc")
    start = np.random.default_rng(0).normal(size=K.shape[0])
    squares, free = eigsh(K, count, M=M, sigma=0.0, v0=start)
    columns = np.zeros((scene.mesh.n_vertices, 3, count))
    columns[scene.free] = free[:, np.argsort(squares)].reshape(-1, 3, count)
    return Basis.of(columns.reshape(-1, count), scene.mass)


def measure(run: Run) -> list[Row]:
    """The rows of one run; a frame that one basis has no relaxed pose of is left out of all."""
    rows = list[Row]()
    bases = {"PCA": run.basis, "modes": modes(run.scene, max(SIZES))}
    for role in (role for role in ("train", "validation") if run.snapshots.with_role(role)):
        frames = list(frames_of(run, role))
        moved = np.array([np.linalg.norm(u, axis=1).mean() for u, _ in frames])
        found = {
            (kind, r): slaving(Compliance(run.scene, basis.columns(r)), frames).off * np.maximum(moved, moved.mean())
            for kind, basis in bases.items()
            for r in SIZES
        }
        fine = np.isfinite(list(found.values())).all(axis=0)
        share = np.maximum(moved, moved[fine].mean())
        for (kind, r), metres in found.items():
            worst = float((metres / share)[fine].max())
            rows.append(row(run.experiment, f"worst frame, {role}, {r} columns of {kind}", worst))
        rows.append(row(run.experiment, f"frames, {role}", int(fine.sum())))
        rows.append(row(run.experiment, f"frames left out, {role}", int((~fine).sum())))
    return rows


def main() -> None:
    over_runs(NAME, __doc__, measure, ROOMS)


if __name__ == "__main__":
    main()
