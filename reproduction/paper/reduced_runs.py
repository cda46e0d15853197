"""Reading a run for an experiment: its scene, spaces and motions, and playing them in spaces of other sizes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import StoredModel, read_basis, read_cubature, read_model, read_scene
from ldsim.artefacts.snapshots import Recorded, Snapshots
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.trajectory import Trajectory
from ldsim.mechanics.scene import Scene
from ldsim.pipeline.comparison import run_reduced, with_errors
from ldsim.space.decoder import Decoder
from ldsim.space.pca import Basis, inner_product
from ldsim.space.projection import all_coordinates

Array = NDArray[np.float64]

STOP = 1e-8


@dataclass(frozen=True, eq=False)
class Material:
    """What experiments read of a run: its files are opened when they are asked for."""

    folder: Path
    snapshots: Snapshots

    @cached_property
    def scene(self) -> Scene:
        return read_scene(self.folder / "scene.h5")[0]

    @cached_property
    def basis(self) -> Basis:
        return read_basis(self.folder / "basis.h5")[0].basis

    @cached_property
    def model(self) -> StoredModel:
        return read_model(self.folder / "model.h5")[0]

    def cubature(self, space: str, stepped: bool = False) -> CubatureRule:
        """The chosen set on the mesh, as the paper's are, or what `simulate` steps with."""
        stored = read_cubature(self.folder / "cubature.h5")[0][space]
        return stored.stepped if stepped else stored.best

    @property
    def names(self) -> list[str]:
        return list(self.snapshots.names)

    def recorded(self, name: str) -> Recorded:
        return self.snapshots.recorded(name)

    def frame(self, name: str, i: int) -> Array:
        """The displacement after frame i of a motion, (n, 3), metres."""
        return np.asarray(self.snapshots.reader(name)(i, i + 1)[0], dtype=np.float64)

    def frames(self, name: str) -> Array:
        """All frames of a motion, (N, n, 3), metres; for small meshes."""
        return np.asarray(self.snapshots.reader(name)(0, self.snapshots.frames(name)), dtype=np.float64)

    @cached_property
    def training_coordinates(self) -> Array:
        """q of the training snapshots, (N, k)."""
        names = self.snapshots.with_role("train")
        metric = inner_product(self.scene.mass, "mass")
        return all_coordinates(lambda: self.snapshots.chunks(names), metric, self.basis.U)

    def largest_error(self, decoded: Array) -> float:
        """Largest vertex distance, mm, of the training snapshots from U q for decoded coordinates q, (N, ≤ k)."""
        U, largest, first = self.basis.U[:, : decoded.shape[1]], 0.0, 0
        for chunk in self.snapshots.chunks(self.snapshots.with_role("train")):
            off = decoded[first : first + len(chunk)] @ U.T - chunk.reshape(len(chunk), -1)
            largest = max(largest, float((off.reshape(len(chunk), -1, 3) ** 2).sum(axis=2).max()))
            first += len(chunk)
        return 1e3 * float(np.sqrt(largest))

    def play(
        self,
        motion: str,
        decoder: Decoder,
        points: CubatureRule | None = None,
        frames: int | None = None,
        scene: Scene | None = None,
        current: bool = True,
    ) -> Trajectory:
        """Run a motion in the space of a decoder, with every quadrature point unless a set is given; with errors."""
        scene = scene or self.scene
        U = np.ascontiguousarray(self.basis.U[:, : decoder.k])
        chosen = CubatureRule.every(scene) if points is None else points
        stepper = ReducedStepper(scene, U, decoder, chosen, tolerance=STOP, max_iterations=200, current=current)
        recorded = self.recorded(motion)
        count = min(frames or recorded.motion.frames, recorded.motion.frames)
        run = run_reduced(stepper, scene, recorded.motion, recorded.held, range(count))
        return with_errors(run, U, self.snapshots.reader(motion), run)


@contextmanager
def opened(folder: Path) -> Iterator[Material]:
    """The run in a folder, its snapshots open."""
    with Snapshots(folder / "snapshots.h5") as snapshots:
        yield Material(folder, snapshots)


def relative_error(run: Trajectory) -> float:
    """Online error: mean vertex distance over mean displacement; infinite for a run that diverged."""
    assert run.mean_error is not None and run.mean_displacement is not None
    return float(run.mean_error.sum() / run.mean_displacement.sum())
