"""The solids that benchmarks/cubature.py measures, each at the latent dimension of the paper's Table 1.

What a finished run of the pipeline has is linked, not made again; only the autoencoder is trained where the run has
another latent dimension. Everything else is made by the stages themselves, and stays for the next time.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import read_basis, read_model, read_scene
from ldsim.artefacts.snapshots import Snapshots
from ldsim.cubature.selection import PoseSpace
from ldsim.dynamics.reduced.stepper import reduced_rest_stiffness
from ldsim.mechanics.scene import Scene
from ldsim.mesh.refine import EDGES, refined
from ldsim.settings import load_settings
from ldsim.space.pca import inner_product
from ldsim.space.projection import all_coordinates

Array = NDArray[np.float64]

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"
# Cubature is judged by the forces of decoded poses: a short training without forces or synthetic motions serves.
TRAINING = {"epochs": 400, "equilibrium": None, "synthetic": None}
STAGES = {"mesh": "scene", "snapshot": "snapshots", "pca": "basis", "train": "model"}


@dataclass(frozen=True)
class Source:
    """Where a solid comes from.

    Attributes:
        config: of its experiment. r: latent dimension of the paper's Table 1.
        mesh: another one than the configuration's.
        refined: whether the poses are carried over to the mesh refined once.
    """

    config: Path
    r: int
    mesh: str | None = None
    refined: bool = False


DRAGON = HERE / "cubature_dragon.yaml"
SOURCES = {
    "x": Source(CONFIGS / "x.yaml", 6),
    "beam": Source(CONFIGS / "beam.yaml", 10),
    "elephant": Source(CONFIGS / "elephant.yaml", 7),
    "armadillo": Source(HERE / "cubature_armadillo.yaml", 20),
    "dragon": Source(DRAGON, 11, refined=True),
}
# The same solid in fewer cells, for the growth of the time.
SIZES = {
    "dragon_56822": Source(DRAGON, 11),
    "dragon_6216": Source(DRAGON, 11, "$LDSIM_DATA/meshes/dragon_6216.mesh"),
}
DEMO = {"demo": Source(CONFIGS / "demo.yaml", 8)}


@dataclass(frozen=True, eq=False)
class Model:
    """A solid with its latent space and the poses of its motions.

    Attributes:
        space: with the poses of the training motions.
        unseen: codes of the poses of the held-out motions, (N, r).
        snapshots: open as long as the model is.
    """

    name: str
    space: PoseSpace
    unseen: Array
    snapshots: Snapshots

    @property
    def cells(self) -> int:
        return self.space.scene.mesh.n_cells


@contextmanager
def model(name: str, runs: Path, made: Path) -> Iterator[Model]:
    """A solid by name; what no finished run in `runs` has is made in `made` first."""
    folder = prepared(name, runs, made)
    scene, _ = read_scene(folder / "scene.h5")
    U = read_basis(folder / "basis.h5")[0].basis.U
    stored, _ = read_model(folder / "model.h5")
    metric = inner_product(scene.mass, "mass")
    with Snapshots(folder / "snapshots.h5") as snapshots:

        def codes(role: str) -> Array:
            names = snapshots.with_role(role)
            return stored.encoder(all_coordinates(lambda: snapshots.chunks(names), metric, U))

        frames = snapshots.frame_reader(snapshots.with_role("train"))
        stiffness = reduced_rest_stiffness(scene, U)
        space = PoseSpace(scene, U, stored.decoder, stiffness, codes("train"), frames)
        if _source(name).refined:
            space = once_refined(space)
        yield Model(name, space, codes("heldout"), snapshots)


def once_refined(space: PoseSpace) -> PoseSpace:
    """The same motions on the mesh refined once: every tet is eight, and a pose is what it was at every point of space.

    Linear interpolation of the basis keeps all strains, so K̃₀ and the autoencoder stay what they are. So do the
    points that a set of some error needs; what a finer mesh asks for is time and memory.
    """
    coarse = space.scene
    mesh, count = refined(coarse.mesh), coarse.mesh.n_vertices
    ends = np.sort(coarse.mesh.cells[:, EDGES].astype(np.int64), axis=2)
    first, second = np.divmod(np.unique(ends[..., 0] * count + ends[..., 1]), count)

    def finer(nodal: NDArray[np.floating]) -> NDArray[np.floating]:
        return np.concatenate([nodal, (nodal[first] + nodal[second]) / 2])

    U = finer(space.U.reshape(count, 3, -1)).reshape(3 * mesh.n_vertices, -1)
    eight = {name: np.repeat(getattr(coarse, name), 8) for name in ("material", "mu", "lam", "density")}
    pinned = np.concatenate([coarse.pinned, coarse.pinned[first] & coarse.pinned[second]])
    scene: Scene = replace(coarse, mesh=mesh, pinned=pinned, **eight)
    return replace(space, scene=scene, U=U, displacement=lambda t: finer(space.displacement(t)))


def prepared(name: str, runs: Path, made: Path) -> Path:
    """The folder that has all artefacts up to the autoencoder of the paper's r; an interrupted stage goes on."""
    source = _source(name)
    name = "dragon_56822" if source.refined else name
    settings = load_settings(source.config)
    changes: dict[str, Any] = {"experiment": name}
    changes["train"] = settings.train.replace(r=source.r, **TRAINING)
    if source.mesh is not None:
        changes["mesh"] = settings.mesh.model_copy(update={"file": source.mesh})
    folder, config = made / name, made / f"{name}.yaml"
    folder.mkdir(parents=True, exist_ok=True)
    config.write_text(settings.model_copy(update=changes).dump())
    _link(runs / name, folder, source.r)
    for stage, artefact in STAGES.items():
        if not (folder / f"{artefact}.h5").exists():
            command = [sys.executable, "-m", "ldsim", stage, str(config), "--runs", str(made)]
            if subprocess.run(command).returncode:
                sys.exit(f"{name}: ldsim {stage} failed, see above")
    return folder


def _source(name: str) -> Source:
    return (SOURCES | SIZES | DEMO)[name]


def _link(run: Path, folder: Path, r: int) -> None:
    """What a finished run has, if it has all of it, to the folder; its autoencoder if that has r dimensions."""
    files = [run / f"{artefact}.h5" for artefact in STAGES.values()]
    if not all(file.exists() for file in files):
        return
    if read_model(files[-1])[0].decoder.r != r:
        files.pop()
    for file in files:
        if not (folder / file.name).exists():
            (folder / file.name).symlink_to(file.resolve())
