"""The solids that benchmarks/cubature.py measures: finished runs, and runs that it makes as cheaply as is honest."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import read_basis, read_model, read_scene
from ldsim.artefacts.snapshots import Snapshots
from ldsim.dynamics.reduced_model import reduced_rest_stiffness
from ldsim.mechanics.scene import Scene
from ldsim.mesh.refine import EDGES, refined
from ldsim.reduction.autoencoder import TrainingOptions, train
from ldsim.reduction.cubature.selection import PoseSpace
from ldsim.reduction.encoder import Encoder
from ldsim.reduction.pca import inner_product
from ldsim.reduction.reconstruction import all_coordinates

Array = NDArray[np.float64]

HERE = Path(__file__).parent
MADE = {"armadillo": "cubature_armadillo", "dragon": "cubature_dragon"}
STAGES = {"mesh": "scene", "snapshot": "snapshots", "pca": "basis", "train": "model"}
EPOCHS = 600


@dataclass(frozen=True, eq=False)
class Model:
    """A solid with a latent space and the poses of its training motions.

    Attributes:
        encoder: of the latent space.
        folder: of the artefacts.
        snapshots: open as long as the model is, for a closure reads true poses.
    """

    name: str
    space: PoseSpace
    encoder: Encoder
    folder: Path
    snapshots: Snapshots

    @property
    def cells(self) -> int:
        return self.space.scene.mesh.n_cells


def finished(name: str, folder: Path, r: int | None = None) -> Model:
    """The model of a run; with another latent dimension than the run's, trained here in some hundred epochs."""
    scene, _ = read_scene(folder / "scene.h5")
    U = read_basis(folder / "basis.h5")[0].basis.U
    model, _ = read_model(folder / "model.h5")
    snapshots = Snapshots(folder / "snapshots.h5").__enter__()
    names = snapshots.with_role("train")
    q = all_coordinates(lambda: snapshots.chunks(names), inner_product(scene.mass, "mass"), U)
    decoder, encoder = model.decoder, model.encoder
    if r is not None and r != decoder.r:
        trained = train(q, r, TrainingOptions(epochs=EPOCHS))
        decoder, encoder = trained.decoder, trained.encoder
    space = PoseSpace(scene, U, decoder, reduced_rest_stiffness(scene, U), encoder(q), snapshots.frame_reader(names))
    return Model(name, space, encoder, folder, snapshots)


def made(name: str, runs: Path) -> Model:
    """A model whose run is made first, stage by stage; what is there is kept, a broken snapshot stage goes on."""
    experiment = MADE[name]
    for stage, artefact in STAGES.items():
        if not (runs / experiment / f"{artefact}.h5").exists():
            config = HERE / f"{experiment}.yaml"
            command = [sys.executable, "-m", "ldsim", stage, str(config), "--runs", str(runs)]
            subprocess.run(command, check=True)
    return finished(name, runs / experiment)


def once_refined(model: Model) -> Model:
    """The same motions on the mesh refined once: every tet is eight, and a pose is what it was at every point of space.

    Linear interpolation of the basis keeps all strains, so K̃₀ and the autoencoder stay what they are.
    """
    coarse = model.space.scene
    mesh = refined(coarse.mesh)
    ends = np.sort(coarse.mesh.cells[:, EDGES].astype(np.int64), axis=2)
    first, second = np.divmod(np.unique(ends[..., 0] * coarse.mesh.n_vertices + ends[..., 1]), coarse.mesh.n_vertices)

    def finer(nodal: NDArray[np.floating]) -> NDArray[np.floating]:
        return np.concatenate([nodal, (nodal[first] + nodal[second]) / 2])

    U = finer(model.space.U.reshape(coarse.mesh.n_vertices, 3, -1)).reshape(3 * mesh.n_vertices, -1)
    eight = {name: np.repeat(getattr(coarse, name), 8) for name in ("material", "mu", "lam", "density")}
    pinned = np.concatenate([coarse.pinned, coarse.pinned[first] & coarse.pinned[second]])
    scene: Scene = replace(coarse, mesh=mesh, pinned=pinned, **eight)
    space = replace(model.space, scene=scene, U=U, displacement=lambda t: finer(model.space.displacement(t)))
    return replace(model, name=f"{model.name} refined", space=space)
