"""The solids that benchmarks/cubature.py measures, each at the latent dimension of the paper's Table 1.

What a finished run of the pipeline has is linked, not made again; only the autoencoder is trained where the run has
another latent dimension. Everything else is made by the stages themselves, and stays for the next time.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import read_basis, read_model, read_scene
from ldsim.artefacts.snapshots import Snapshots
from ldsim.dynamics.reduced_model import reduced_rest_stiffness
from ldsim.reduction.cubature.selection import PoseSpace
from ldsim.reduction.pca import inner_product
from ldsim.reduction.reconstruction import all_coordinates
from ldsim.settings import dump, load_settings

Array = NDArray[np.float64]

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"
# Cubature is judged on decoded poses, which a short training shapes as well as a long one.
TRAINING = {"epochs": 400, "equilibrium_poses": 100}
STAGES = {"mesh": "scene", "snapshot": "snapshots", "pca": "basis", "train": "model"}


@dataclass(frozen=True)
class Source:
    """Where a solid comes from.

    Attributes:
        config: of its experiment.
        r: latent dimension of the paper's Table 1.
        changes: settings that differ from the configuration's, by section.
    """

    config: Path
    r: int
    changes: dict[str, dict[str, Any]] | None = None


def _dragon(mesh: str, refine: int) -> Source:
    changes = {"mesh": {"file": f"$LDSIM_DATA/meshes/{mesh}.mesh", "refine": refine}}
    return Source(HERE / "cubature_dragon.yaml", 11, changes)


SOURCES = {
    "x": Source(CONFIGS / "x.yaml", 6),
    "beam": Source(CONFIGS / "beam.yaml", 10),
    "elephant": Source(CONFIGS / "elephant.yaml", 7),
    "armadillo": Source(HERE / "cubature_armadillo.yaml", 20),
    "dragon": Source(HERE / "cubature_dragon.yaml", 11),
}
DEMO = {"demo": Source(CONFIGS / "demo.yaml", 8)}
# The same solid in fewer cells, for the growth of the time.
SIZES = {"dragon_6216": _dragon("dragon_6216", 0), "dragon_56822": _dragon("dragon_56822", 0)}


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
    with Snapshots(folder / "snapshots.h5") as snapshots:

        def codes(role: str) -> Array:
            names = snapshots.with_role(role)
            z: Array = stored.encoder(
                all_coordinates(lambda: snapshots.chunks(names), inner_product(scene.mass, "mass"), U)
            )
            return z

        frames = snapshots.frame_reader(snapshots.with_role("train"))
        stiffness = reduced_rest_stiffness(scene, U)
        yield Model(
            name,
            PoseSpace(scene, U, stored.decoder, stiffness, codes("train"), frames),
            codes("heldout"),
            snapshots,
        )


def prepared(name: str, runs: Path, made: Path) -> Path:
    """The folder that has all artefacts up to the autoencoder of the paper's r; an interrupted stage goes on."""
    source = (SOURCES | SIZES | DEMO)[name]
    settings = load_settings(source.config)
    parts = {"train": {"r": source.r, **TRAINING}} | (source.changes or {})
    changed = {key: getattr(settings, key).model_copy(update=update) for key, update in parts.items()}
    folder, config = made / name, made / f"{name}.yaml"
    folder.mkdir(parents=True, exist_ok=True)
    config.write_text(dump(settings.model_copy(update={"experiment": name} | changed)))
    _link(runs / name, folder, source.r)
    for stage, artefact in STAGES.items():
        if not (folder / f"{artefact}.h5").exists():
            command = [sys.executable, "-m", "ldsim", stage, str(config), "--runs", str(made)]
            if subprocess.run(command).returncode:
                sys.exit(f"{name}: ldsim {stage} failed, see above")
    return folder


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
