"""The spaces that step.py compares: latent ones of runs and a sweep of linear ones, each with its cubature rules.

What takes minutes, the fits, is kept in files, so that a benchmark that was stopped goes on.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ldsim.cubature.choose import PoseSplit, choose_on_mesh, choose_virtual
from ldsim.cubature.options import CubatureOptions, VirtualOptions
from ldsim.cubature.rule import CubatureRule
from ldsim.pipeline.cubature import TrainingPoses
from ldsim.run import Run
from ldsim.space.space import Space
from reproduction.bench.kept import kept_rules

TOLERANCE, MOST, POSES, KEPT_BACK = 0.03, 800, 400, 200
# Virtual points of a linear space, as shares of its rule on the mesh.
LINEAR_SHARES = (0.35, 0.65)
# They are fitted to the forces of decoded poses: with the true ones PCA-40 of x with 58 points was 30 % off on x_1
# instead of 9.7 %.
VIRTUAL = VirtualOptions(poses=4000, steps=3000, closures=(0.0,))


def latent_spaces(run: Run) -> Iterator[Space]:
    """The latent space of a run with what it steps with and, beside virtual points, its best rule on the mesh."""
    space, path = run.space("latent"), run.cubature["latent"]
    yield space
    if path.virtual is not None:
        yield space.with_rule(path.best)


def linear_spaces(run: Run, dimensions: list[int], kept: Path) -> Iterator[Space]:
    """Linear spaces of several dimensions, each with its best rule on the mesh and with virtual points."""
    place = kept / f"{run.experiment}-{run.hash('model')[:12]}"
    poses = TrainingPoses(run, 1)
    for k in dimensions:
        for rule in kept_rules(place / f"linear-{k}.npz", lambda k=k: _rules(poses, k)):  # type: ignore[misc]
            yield Space.linear(run.scene, run.basis, k, rule, run.lifting)


def _rules(poses: TrainingPoses, k: int) -> list[CubatureRule]:
    """On the mesh, and virtual ones of several sizes."""
    space, count = poses.linear(k), len(poses.q)
    options = CubatureOptions(
        tolerance=TOLERANCE,
        max_points=MOST,
        poses=min(POSES, count * 2 // 3),
        heldout_poses=min(KEPT_BACK, count // 3),
    )
    split = PoseSplit.of(count, poses.recorded, options)
    path = choose_on_mesh(space, split, options)
    sizes = [round(share * len(path.best.points)) for share in LINEAR_SHARES]
    virtual = [choose_virtual(space, path, split, VIRTUAL.replace(points=size)).rule for size in sizes]
    return [path.best, *virtual]
