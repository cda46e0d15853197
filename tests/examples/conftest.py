"""A small run with what is exported of it, as somebody who tries the examples has it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from ldsim import Run
from ldsim.arrays import Array
from ldsim.export.formats import Choice, export
from ldsim.mechanics.scene import Scene
from ldsim.runtime.compilers import HERE, compiler
from ldsim.runtime.library import NativeModel, NativeSolid, local_library
from tests.report.small_run import write_run

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project's root in which everything is exported: `.ci/run` fails where there is no compiler."""
    if compiler() is None:
        pytest.skip("no C compiler (cc, gcc or clang) is installed: it builds the library")
    folder = tmp_path_factory.mktemp("root")
    shutil.copytree(EXAMPLES, folder / "examples", symlinks=True)
    run = folder / "runs" / "demo"
    run.mkdir(parents=True)
    write_run(run)
    with Run.open(run) as opened:
        export(opened, Choice("c", platforms=(HERE,)))
        export(opened, Choice("wasm"))
    return folder


@pytest.fixture(scope="module")
def model(root: Path) -> NativeModel:
    """The exported model in the library as Python calls it: the reference of every example."""
    data = (root / "runs" / "demo" / "export" / "demo-c" / "model.ldsim").read_bytes()
    return NativeModel(local_library(), data)


@pytest.fixture(scope="module")
def scene(root: Path) -> Scene:
    with Run.open(root / "runs" / "demo") as run:
        return run.scene


def farthest(scene: Scene) -> int:
    """The movable vertex farthest from the middle of the pins."""
    x = scene.mesh.vertices
    away = np.linalg.norm(x - x[~scene.movable].mean(axis=0), axis=1)
    return int(np.where(scene.movable, away, -1.0).argmax())


def pulled(model: NativeModel, scene: Scene) -> tuple[Array, Array]:
    """Where the vertex hangs and with what force, after 200 steps of the pull that the examples make."""
    solid, vertex = NativeSolid(model), farthest(scene)
    point = scene.mesh.vertices[vertex]
    grab = solid.grab(point, point + [0.0, 0.25 * scene.mesh.diagonal, 0.0])
    for _ in range(200):
        solid.step()
    return point + solid.displacement(np.array([vertex]))[0], solid.force(grab)
