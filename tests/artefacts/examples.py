"""One small artefact of each kind, made of random numbers, with how it is written and read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import issparse

from ldsim.arrays import Array
from ldsim.artefacts.partial import Checkpoint, MotionStore, write_snapshots
from ldsim.artefacts.records import (
    StoredModel,
    read_basis,
    read_cubature,
    read_model,
    read_scene,
    read_simulation,
    write_basis,
    write_cubature,
    write_model,
    write_scene,
    write_simulation,
)
from ldsim.artefacts.snapshots import STATISTICS, Snapshots
from ldsim.artefacts.store import Header
from ldsim.cubature.path import RulePath, VirtualFit
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.trajectory import Trajectory
from ldsim.mechanics.motion import Drag, Motion, Support
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Group
from ldsim.mesh.shapes import beam
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.pca import Pca
from tests.helpers import uniform_scene


@dataclass(frozen=True)
class Example:
    """A kind of artefact: what it holds, how to write it and how to read it back with its header."""

    value: object
    write: Callable[[Path, Header], None]
    read: Callable[[Path], tuple[object, Header]]


def numbers(*shape: int) -> Array:
    return np.random.default_rng(sum(shape)).uniform(0.5, 1.5, shape)


def counts(n: int) -> NDArray[np.int64]:
    return np.random.default_rng(n).integers(1, 9, n)


def scene() -> Scene:
    plain = beam(resolution=1)
    end, none = np.flatnonzero(plain.vertices[:, 0] == 0), np.empty(0, dtype=np.int64)
    mesh = replace(plain, groups={"left end": Group(end, none), "rim": Group(end, np.array([0, 2]))})
    body = uniform_scene(mesh, mesh.vertices[:, 0] == 0, youngs_modulus=1e5, poisson_ratio=0.4)
    return replace(body, load=numbers(mesh.n_vertices, 3))


def basis() -> Pca:
    body = scene()
    U = numbers(3 * body.mesh.n_vertices, 3)
    return Pca(Basis.of(U, body.mass), numbers(5), numbers(4), numbers(4), numbers(4) + 1, numbers(4) + 2)


def read_it(path: Path) -> tuple[Pca, Header]:
    return read_basis(path, scene())


def model() -> StoredModel:
    up = [numbers(2, 6), numbers(6, 4)], [numbers(6), numbers(4)]
    down = (numbers(4, 6), numbers(6, 2)), (numbers(6), numbers(2))
    decoder, encoder = Decoder.network(*up, activation="tanh"), Encoder(*down, "tanh")
    return StoredModel(decoder, encoder, numbers(9, 2), numbers(3, 3), numbers(2, 2), 3, 5)


def cubature() -> dict[str, RulePath]:
    def stored(*sizes: int) -> RulePath:
        rules = (CubatureRule(np.arange(n) * 2, numbers(n), 1.0 / n, None, 2.0 / n, 3.0 / n) for n in sizes)
        return RulePath(tuple(rules), 1)

    found = VirtualFit(
        CubatureRule(np.arange(3), 1 + numbers(3), 0.25, numbers(3, 9, 4), 0.5, 0.75), 1.0, numbers(3, 2)
    )
    return {"latent": replace(stored(2, 5, 9), virtual=found), "linear": stored(3, 4)}


def simulation() -> dict[str, dict[str, Trajectory]]:
    def run(n: int, *size: int) -> Trajectory:
        whole = Trajectory(counts(n), counts(n), counts(n) % 4, numbers(n))
        if not size:
            return whole
        return Trajectory(
            whole.iterations, whole.evaluations, whole.reason, whole.seconds, numbers(n, size[0]), mean_error=numbers(n)
        )

    return {"full": {"a": run(3)}, "latent": {"a": run(5, 4), "b": run(6, 4)}}


MOTIONS = (
    Motion(
        "b", 3, (Drag(0, numbers(3), numbers(2, 3), 0.1, 30.0), Drag(2, numbers(3), numbers(1, 3), 0.2, 40.0, True))
    ),
    Motion(
        "a",
        2,
        (),
        numbers(2, 3),
        (Support(np.array([0, 3]), numbers(2, 3, 4)), Support(np.array([1]), numbers(2, 3, 4) + 1)),
    ),
)
FRAMES = {motion.name: numbers(motion.frames, 4, 3).astype(np.float32) for motion in MOTIONS}
HELD = {0: np.array([1, 3]), 1: np.array([2])}


def statistics_of(motion: Motion) -> tuple[NDArray[np.int64], ...]:
    return counts(motion.frames), counts(motion.frames), counts(motion.frames) % 4


def write_motions(path: Path, header: Header) -> None:
    stores = []
    for motion, role in zip(MOTIONS, ("train", "validation"), strict=True):
        store = MotionStore(path.parent / f"{path.name}.partial", motion)
        store.start()
        for u in FRAMES[motion.name]:
            store.append(u.astype(np.float64))
        statistics = dict(zip(STATISTICS, statistics_of(motion), strict=True))
        held = HELD if motion.drags else {}
        store.write_checkpoint(Checkpoint("", {"u": numbers(4, 3)}, held, statistics, numbers(motion.frames)))
        stores.append((store, motion, role))
    write_snapshots(path, header, stores, 4)


def read_motions(path: Path, kind: str = "snapshots") -> tuple[object, Header]:
    with Snapshots(path, kind=kind) as snapshots:
        found = [
            (
                (entry := snapshots.recorded(name)).motion,
                entry.role,
                dict(entry.held),
                snapshots.reader(name)(0, entry.motion.frames),
                (entry.iterations, entry.evaluations, entry.reason, entry.seconds),
            )
            for name in snapshots.names
        ]
        return found, snapshots.header


def recorded_motions() -> object:
    return [
        (
            motion,
            role,
            HELD if motion.drags else {},
            FRAMES[motion.name],
            (*statistics_of(motion), numbers(motion.frames)),
        )
        for motion, role in zip(MOTIONS, ("train", "validation"), strict=True)
    ]


EXAMPLES = {
    "scene": Example(scene(), lambda path, header: write_scene(path, header, scene()), read_scene),
    "snapshots": Example(recorded_motions(), write_motions, read_motions),
    "tests": Example(recorded_motions(), write_motions, lambda path: read_motions(path, "tests")),
    "basis": Example(basis(), lambda path, header: write_basis(path, header, basis()), read_it),
    "model": Example(model(), lambda path, header: write_model(path, header, model()), read_model),
    "cubature": Example(cubature(), lambda path, header: write_cubature(path, header, cubature()), read_cubature),
    "simulation": Example(
        simulation(), lambda path, header: write_simulation(path, header, simulation()), read_simulation
    ),
}


def same(a: object, b: object) -> bool:
    """Whether two values hold the same, arrays to the last bit and type, all the way down."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)  # type: ignore[attr-defined, index]
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(same, a, b))  # type: ignore[arg-type]
    if is_dataclass(a):
        return all(same(getattr(a, entry.name), getattr(b, entry.name)) for entry in fields(a))
    if issparse(a):
        return (a != b).nnz == 0
    return a == b
