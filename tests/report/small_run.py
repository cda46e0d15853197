"""A run of a small beam, written through the artefact writers: consistent in every number, made up in its motions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.artefacts.partial import Checkpoint, MotionStore, write_snapshots
from ldsim.artefacts.records import StoredModel, write_basis, write_cubature, write_model, write_scene, write_simulation
from ldsim.artefacts.store import STAGE_OF, Header, file_hash
from ldsim.cubature.path import RulePath
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.trajectory import Trajectory
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.optimise.solution import Reason
from ldsim.pipeline.comparison import Reference, with_errors
from ldsim.run import Run
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.pca import Pca, errors_against_k, orthonormalised
from ldsim.space.projection import matching_dimension, reconstruction_error
from ldsim.space.space import Space
from tests.helpers import scene as scene_of

NAME = "tiny"
K, R = 4, 2
FRAMES = {"pull_1": 14, "push": 11}
ROLES = {"pull_1": "train", "push": "validation"}
FULL_FRAMES = 6
SETTINGS = {"cubature": "tolerance: 0.11", "model": "tolerance_mm: 100.0"}
LOST_FROM = 5
CONFIG = f"""
experiment: {NAME}
mesh:
  shape: {{name: beam}}
  material: {{youngs_modulus: 1.0e+5}}
  pins: [{{slab: {{axis: x, thickness: 0.001}}}}]
snapshot:
  motions:
    - {{name: pull_1, pulls: {{count: 1, reach: 0.1}}}}
    - {{name: push, role: validation, pulls: {{count: 1, reach: 0.1}}}}
cubature: {{tolerance: 0.06}}
report: {{pictures: false}}
"""


def write_run(folder: Path, lost: tuple[str, str] | None = None, validation: bool = True) -> None:
    """Write the six artefacts of a run.

    Args:
        lost: space and motion of a run that diverges at frame `LOST_FROM`.
        validation: whether there is a validation motion.
    """
    scene = scene_of(beam(length=0.25, resolution=2))
    motions = [name for name in FRAMES if validation or ROLES[name] == "train"]
    write_scene(folder / "scene.h5", _header(folder, "scene"), scene)
    U = _modes(scene)
    fields = {name: _displacements(U, FRAMES[name], seed) for seed, name in enumerate(motions)}
    _write_snapshots(folder, scene, fields)
    pca = _write_basis(folder, scene, U, fields)
    model = _write_model(folder, pca, fields)
    _write_cubature(folder)
    _write_simulation(folder, U, model, fields, scene, lost)


def changed(run: Run, kind: str, value: object = None, settings: str = "", **notes: str | float | int) -> Run:
    """The same run with another content, or other settings or notes in the header, of one artefact."""
    old, header = getattr(run, {"basis": "pca"}.get(kind, kind)), run.header(kind)
    other = replace(header, settings=settings or header.settings, notes={**header.notes, **notes})
    run._read[kind] = (old if value is None else value, other)
    return run


def _header(folder: Path, kind: str, **notes: str | float | int) -> Header:
    """A header with the hashes of everything written before."""
    inputs = {name: file_hash(folder / f"{name}.h5") for name in STAGE_OF if (folder / f"{name}.h5").is_file()}
    number = list(STAGE_OF).index(kind)
    cost: dict[str, float] = {"seconds": 1.5 + number, "peak_memory_mb": 100.25 + number}
    return Header(
        kind, SETTINGS.get(kind, ""), inputs, 0, {"experiment": NAME, "stage": STAGE_OF[kind], **cost, **notes}
    )


def _modes(scene: Scene) -> Array:
    """Smooth orthonormal modes that vanish at the pins, (3n, K)."""
    x = scene.mesh.vertices[:, 0] / scene.mesh.vertices[:, 0].max()
    modes = np.zeros((scene.mesh.n_vertices, 3, K))
    for j, axis in enumerate((1, 2, 1, 0)):
        modes[:, axis, j] = x ** (2 + j)
    return orthonormalised(modes.reshape(-1, K), scene.mass).matrix


def _displacements(U: Array, frames: int, seed: int) -> NDArray[np.float32]:
    """A swing with a little of what no mode holds, (N, n, 3) metres."""
    rng = np.random.default_rng(seed)
    amplitudes = np.array([0.03, 0.01, 0.003, 0.001]) * rng.uniform(0.5, 1.5, K)
    phase = np.linspace(0, 5, frames)[:, None] * np.arange(1, K + 1)
    rough = 1e-4 * rng.normal(size=(frames, len(U)))
    return (np.sin(phase) * amplitudes @ U.T + rough).reshape(frames, -1, 3).astype(np.float32)


def _write_snapshots(folder: Path, scene: Scene, fields: dict[str, NDArray[np.float32]]) -> None:
    stores = []
    for name, field in fields.items():
        targets = np.array([0.25, 0.05, 0.0]) + np.linspace(0, 0.02, 4)[:, None]
        motion = Motion(name, len(field), (Drag(2, np.array([0.25, 0.0, 0.0]), targets, 0.03, 30.0, True),))
        store = MotionStore(folder, motion)
        store.start()
        for u in field:
            store.append(u.astype(np.float64))
        counts = np.full(len(field), 5, dtype=np.int64)
        statistics = {"iterations": counts, "evaluations": counts + 1, "reason": 0 * counts}
        held = {0: np.argsort(-scene.mesh.vertices[:, 0], kind="stable")[:3]}
        store.write_checkpoint(Checkpoint("id", {}, held, statistics, np.full(len(field), 0.2)))
        stores.append((store, motion, ROLES[name]))
    write_snapshots(folder / "snapshots.h5", _header(folder, "snapshots"), stores, scene.mesh.n_vertices)


def _write_basis(folder: Path, scene: Scene, U: Array, fields: dict[str, NDArray[np.float32]]) -> Pca:
    basis = Basis.of(U, scene.mass)

    def errors(role: str) -> tuple[Array, Array]:
        rows = [field.reshape(len(field), -1) for name, field in fields.items() if ROLES[name] == role]
        return errors_against_k(lambda: rows, basis)

    validation = errors("validation") if "validation" in map(ROLES.get, fields) else (None, None)
    pca = Pca(basis, np.array([0.1, 0.03, 0.01, 0.003, 1e-4]), *errors("train"), *validation)
    write_basis(folder / "basis.h5", _header(folder, "basis"), pca)
    return pca


def _write_model(folder: Path, pca: Pca, fields: dict[str, NDArray[np.float32]]) -> StoredModel:
    """A decoder that is linear: the first R modes."""
    narrow = np.eye(R, K)
    decoder = Decoder.network([narrow], [np.zeros(K)])
    encoder = Encoder((narrow.T.copy(),), (np.zeros(R),))

    def errors(role: str) -> tuple[float, float]:
        rows = [field.reshape(len(field), -1) for name, field in fields.items() if ROLES[name] == role]
        return reconstruction_error(lambda: rows, pca.basis, encoder, decoder)

    measured = np.array([errors("train"), errors("validation")])
    loss = np.stack([np.geomspace(1, 1e-3, 8), np.geomspace(1.1, 2e-3, 8)], axis=1)
    kp = matching_dimension(pca.max_error, measured[0, 0]) + 1
    model = StoredModel(decoder, encoder, loss, np.array([[R, 1.0, 0.1]]), measured, kp, 7)
    write_model(folder / "model.h5", _header(folder, "model", activation="elu", met=1), model)
    return model


def _write_cubature(folder: Path) -> None:
    spaces = {}
    for space, shift in (("latent", 0), ("linear", 3)):
        counts = (2 + shift, 5 + shift)
        rules = tuple(
            CubatureRule(np.arange(count), np.full(count, 1e-5), error, heldout_error=heldout)
            for count, error, heldout in zip(counts, (0.2, 0.05), (0.25, 0.07 + shift / 100), strict=True)
        )
        spaces[space] = RulePath(rules, 1)
    notes = {"latent_seconds": 3.25, "linear_seconds": 4.5}
    write_cubature(folder / "cubature.h5", _header(folder, "cubature", **notes), spaces)


def _write_simulation(
    folder: Path,
    U: Array,
    model: StoredModel,
    fields: dict[str, NDArray[np.float32]],
    scene: Scene,
    lost: tuple[str, str] | None,
) -> None:
    rng = np.random.default_rng(7)
    runs: dict[str, dict[str, Trajectory]] = {"full": {}, "linear": {}, "latent": {}}
    for name, field in fields.items():
        runs["full"][name] = _trajectory(rng, FULL_FRAMES, 0.1)
        q = Basis.of(U, scene.mass).project(field)
        for space, columns, milliseconds in (("linear", model.kp, 4.0), ("latent", K, 0.5)):
            near = [q[:, :columns] + size * rng.normal(size=(len(q), columns)) for size in (2e-3, 5e-4)]
            run = replace(_trajectory(rng, len(field), milliseconds / 1e3), coordinates=near[0])
            if space == "latent":
                run = replace(run, latent=near[0][:, :R].copy())
            if (space, name) == lost:
                run = _lost(run)
            windowed = replace(run, coordinates=near[1])
            reference = Reference(Motion(name, len(field)), {}, lambda a, b, data=field: data[a:b])
            held = Space.linear(scene, Basis.of(U, scene.mass), columns)
            runs[space][name] = with_errors(run, held, reference, windowed)
    notes = {"latent_points": 5, "linear_points": 8, "space": "latent"}
    write_simulation(folder / "simulation.h5", _header(folder, "simulation", **notes), runs)


def _trajectory(rng: np.random.Generator, frames: int, seconds: float) -> Trajectory:
    iterations = rng.integers(2, 9, frames)
    times = seconds * rng.uniform(0.8, 1.6, frames)
    return Trajectory(iterations, iterations + rng.integers(0, 3, frames), np.zeros(frames, dtype=np.int64), times)


def _lost(run: Trajectory) -> Trajectory:
    """The run as `comparison.run_reduced` leaves one that is lost: its last step took time, then there is nothing."""
    assert run.coordinates is not None
    q, reason = run.coordinates.copy(), run.reason.copy()
    q[LOST_FROM:] = np.nan
    reason[LOST_FROM:] = Reason.INFINITE_START
    seconds, iterations, evaluations = run.seconds.copy(), run.iterations.copy(), run.evaluations.copy()
    seconds[LOST_FROM + 1 :] = np.nan
    iterations[LOST_FROM + 1 :] = evaluations[LOST_FROM + 1 :] = 0
    return replace(run, coordinates=q, reason=reason, seconds=seconds, iterations=iterations, evaluations=evaluations)
