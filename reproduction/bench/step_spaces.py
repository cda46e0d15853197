"""The spaces that benchmarks/step.py compares: latent ones of runs and a sweep of linear ones, each with its cubatures.

What takes minutes, the fits, is kept in files, so that a benchmark that was stopped goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import read_basis, read_cubature, read_model, read_scene
from ldsim.artefacts.snapshots import Snapshots
from ldsim.artefacts.store import file_hash
from ldsim.cubature.aims import Aiming, Aims
from ldsim.cubature.goal import Goal
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.selection import PoseSpace, Recipe, select, split_poses
from ldsim.cubature.virtual import VirtualRecipe, choose_poses, fit_virtual, largest
from ldsim.dynamics.reduced.stepper import reduced_rest_stiffness
from ldsim.pipeline.comparison import ReducedSpace
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.pca import inner_product
from ldsim.space.projection import all_coordinates

Array = NDArray[np.float64]

TOLERANCE, MOST, POSES, KEPT_BACK = 0.03, 800, 400, 200
# Virtual points of a linear space, as shares of its set on the mesh.
LINEAR_SHARES = (0.35, 0.65)
VIRTUAL = VirtualRecipe(0, poses=4000, steps=3000)


def latent_spaces(folder: Path) -> Iterator[ReducedSpace]:
    """The latent space of a run with what it steps with and, beside virtual points, its best set on the mesh."""
    U = read_basis(folder / "basis.h5")[0].basis.U
    model, _ = read_model(folder / "model.h5")
    sets = read_cubature(folder / "cubature.h5")[0]["latent"]
    for points in [sets.stepped, *([sets.best] if sets.virtual else [])]:
        yield ReducedSpace("latent", U, model.decoder, model.encoder, points)


def linear_spaces(folder: Path, dimensions: list[int], kept: Path) -> Iterator[ReducedSpace]:
    """Linear spaces of several dimensions, each with its best set on the mesh and with virtual points."""
    U = read_basis(folder / "basis.h5")[0].basis.U
    place = kept / f"{folder.name}-{file_hash(folder / 'model.h5')[:12]}"
    for k in dimensions:
        identity = Decoder.identity(k)

        def make(k: int = k, identity: Decoder = identity) -> list[CubatureRule]:
            with _pose_space(folder, identity, lambda q: np.ascontiguousarray(q[:, :k])) as (space, recorded):
                poses = len(space.z)
                fitted, kept_back = split_poses(poses, min(POSES, poses * 2 // 3), min(KEPT_BACK, poses // 3), seed=0)
                found = select(space, fitted, kept_back, Recipe(Goal(TOLERANCE, MOST), threads=1)).fit
                sizes = tuple(round(share * len(found.best.points)) for share in LINEAR_SHARES)
                return [found.best, *_virtual(space, found.ladder, recorded, sizes)]

        for points in _kept(place / f"linear-{k}.npz", make):
            yield ReducedSpace("linear", np.ascontiguousarray(U[:, :k]), identity, Encoder((), ()), points)


@contextmanager
def _pose_space(folder: Path, decoder: Decoder, encode: Callable[[Array], Array]) -> Iterator[tuple[PoseSpace, int]]:
    """The poses of a run in a space of the first columns of its basis, and how many are recorded."""
    scene, _ = read_scene(folder / "scene.h5")
    U = read_basis(folder / "basis.h5")[0].basis.U
    model, _ = read_model(folder / "model.h5")
    metric, k = inner_product(scene.mass, "mass"), decoder.k
    stiffness, narrow = reduced_rest_stiffness(scene, U)[:k, :k], np.ascontiguousarray(U[:, :k])
    with Snapshots(folder / "snapshots.h5") as snapshots:
        names = snapshots.with_role("train")
        q: Array = all_coordinates(lambda: snapshots.chunks(names), metric, U)
        recorded, read = len(q), snapshots.frame_reader(names)
        q = q if model.synthetic is None else np.concatenate([q, model.synthetic])

        def true_pose(t: int) -> NDArray[np.floating]:
            return read(t) if t < recorded else (U @ q[t]).reshape(-1, 3)

        yield PoseSpace(scene, narrow, decoder, stiffness, encode(q), true_pose), recorded


def _virtual(
    space: PoseSpace, ladder: tuple[CubatureRule, ...], recorded: int, sizes: tuple[int, ...]
) -> list[CubatureRule]:
    """Virtual points of several sizes that aim at the forces of decoded poses: with the true ones PCA-40 of x with 58
    points was 30 % off on x_1 instead of 9.7 %."""
    none = np.empty(0, dtype=np.int64)
    aiming, poses = Aiming(space, none, 1), choose_poses(len(space.z), none, recorded, VIRTUAL)
    fitted, aside = (Aims.joined(*aiming.aims(aiming.forces(part, (0, i)), 0.0)) for i, part in enumerate(poses))
    return [fit_virtual(space.scene, space.U, largest(ladder, size), fitted, aside, VIRTUAL) for size in sizes]


def _kept(path: Path, make: Callable[[], list[CubatureRule]]) -> list[CubatureRule]:
    """The sets of a file, made where there is none."""
    if not path.exists():
        sets = make()
        path.parent.mkdir(parents=True, exist_ok=True)
        arrays = {}
        for i, entry in enumerate(sets):
            arrays |= {f"points_{i}": entry.points, f"weights_{i}": entry.weights, f"error_{i}": entry.training_error}
            arrays |= {} if entry.maps is None else {f"maps_{i}": entry.maps}
        partial = path.with_suffix(".partial.npz")
        np.savez(partial, **arrays)  # type: ignore[arg-type]
        partial.rename(path)
    with np.load(path) as stored:
        return [
            CubatureRule(
                stored[f"points_{i}"],
                stored[f"weights_{i}"],
                float(stored[f"error_{i}"]),
                stored[f"maps_{i}"] if f"maps_{i}" in stored else None,
            )
            for i in range(sum(name.startswith("points_") for name in stored))
        ]
