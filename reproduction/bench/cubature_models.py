"""The solids that cubature.py measures, each at the latent dimension of the paper's Table 1.

What a finished run of the pipeline has is linked, not made again; only the autoencoder is trained where the run has
another latent dimension. Everything else is made by the stages themselves, and stays for the next time.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.samples import PoseSpace
from ldsim.mechanics.scene import Scene
from ldsim.mesh.refine import EDGES, refined
from ldsim.pipeline.cubature import TrainingPoses
from ldsim.run import Run
from ldsim.settings import load_settings
from ldsim.space.basis import Basis
from ldsim.space.projection import all_coordinates
from reproduction.harness import CONFIGS, finished, linked

Array = NDArray[np.float64]

HERE = Path(__file__).parent
# Cubature is judged by the forces of decoded poses: a short training without forces or synthetic motions serves.
TRAINING = {"epochs": 400, "equilibrium": None}
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
        run: open as long as the model is; of the coarser mesh, where the poses are carried over.
        poses: of the training motions.
        unseen: codes of the poses of the held-out motions, (N, r).
    """

    name: str
    run: Run
    poses: PoseSpace
    unseen: Array

    @property
    def cells(self) -> int:
        return self.poses.scene.mesh.n_cells


@contextmanager
def model(name: str, runs: Path, made: Path) -> Iterator[Model]:
    """A solid by name; what no finished run in `runs` has is made in `made` first."""
    with Run.open(prepared(name, runs, made)) as run:
        training = TrainingPoses(run, 0)
        poses = training.latent()
        poses = replace(poses, z=poses.z[: training.recorded])
        if _source(name).refined:
            poses = once_refined(poses)
        yield Model(name, run, poses, run.model.encoder(all_coordinates(run.chunks("validation"), run.basis)))


def once_refined(poses: PoseSpace) -> PoseSpace:
    """The same motions on the mesh refined once: every tet is eight, and a pose is what it was at every point of space.

    Linear interpolation of the basis keeps all strains, so K̃₀ and the autoencoder stay what they are. So do the
    points that a rule of some error needs; what a finer mesh asks for is time and memory.
    """
    coarse, true_pose = poses.scene, poses.displacement
    assert true_pose is not None
    mesh, count = refined(coarse.mesh), coarse.mesh.n_vertices
    ends = np.sort(coarse.mesh.cells[:, EDGES].astype(np.int64), axis=2)
    first, second = np.divmod(np.unique(ends[..., 0] * count + ends[..., 1]), count)

    def finer(nodal: NDArray[np.floating]) -> NDArray[np.floating]:
        return np.concatenate([nodal, (nodal[first] + nodal[second]) / 2])

    eight: dict[str, Any] = {name: np.repeat(getattr(coarse, name), 8) for name in ("material", "mu", "lam", "density")}
    pinned = np.concatenate([coarse.pinned, coarse.pinned[first] & coarse.pinned[second]])
    scene: Scene = replace(coarse, mesh=mesh, pinned=pinned, **eight)
    basis = Basis(np.asarray(finer(poses.space.reduced_basis.fields)), scene.mass)
    space = replace(poses.space, scene=scene, basis=basis, rule=CubatureRule.every(scene), lifting=None)
    return replace(poses, space=space, displacement=lambda t: finer(true_pose(t)), given=None)


def prepared(name: str, runs: Path, made: Path) -> Path:
    """The folder that has all artefacts up to the autoencoder of the paper's r.

    What a finished run has that fits is linked, its autoencoder where that has r dimensions; the rest is made.
    """
    source = _source(name)
    name = "dragon_56822" if source.refined else name
    settings = load_settings(source.config)
    changes: dict[str, Any] = {"experiment": name, "train": settings.train.replace(r=source.r, **TRAINING)}
    changes["pca"] = settings.pca.replace(synthetic=None)
    if source.mesh is not None:
        changes["mesh"] = settings.mesh.replace(file=source.mesh)
    run = runs / name
    if all((run / f"{kind}.h5").exists() for kind in STAGES.values()):
        with Run.open(run) as there:
            kinds = [kind for kind in STAGES.values() if kind != "model"]
            if there.model.decoder.r == source.r:
                kinds, changes["train"] = [*kinds, "model"], settings.train
        linked(run, made / name, kinds)
    made.mkdir(parents=True, exist_ok=True)
    return finished(made / name, settings.replace(**changes), tuple(STAGES), source.config.parent)


def _source(name: str) -> Source:
    return (SOURCES | SIZES | DEMO)[name]
