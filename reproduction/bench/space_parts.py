"""What benchmarks/space.py measures: one space of a finished run on all of its motions, and the streamed PCA."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import yaml
from every_element import EveryElement, State, run
from judging import WINDOW, errors
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse import csr_array, eye_array

from ldsim.artefacts.records import read_basis, read_cubature, read_model, read_scene
from ldsim.artefacts.snapshots import Snapshots
from ldsim.artefacts.store import Header
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.reduced.minimiser import Method
from ldsim.learn.equilibrium import Poses, pose_forces
from ldsim.learn.examples import Examples
from ldsim.learn.options import TrainOptions
from ldsim.learn.training import train
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mechanics.scene import Scene
from ldsim.pipeline.comparison import ReducedSpace
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder, nearest_latent
from ldsim.space.pca import inner_product, leading_modes
from ldsim.space.projection import all_coordinates

Array = NDArray[np.float64]
Row = dict[str, Any]

POSES = 20
# Of the reduced steps, N: 10⁻⁷ of h² times the potential, the loosest of the authors' code.
STOP = 4e-3
QUICK_FRAMES = 60


@dataclass(frozen=True, eq=False)
class Space:
    """A reduced space: its stepper, and the way back from coordinates of the whole basis."""

    name: str
    stepper: EveryElement
    encoder: Encoder

    def state(self, q: Array, frame: int) -> State:
        """The state that continues after a frame of the full-space run with coordinates q, (N, K)."""
        k, decoder = self.stepper.decoder.k, self.stepper.decoder
        now, before = q[frame, :k], q[frame - 1, :k]
        codes = self.encoder(np.stack([now, before]))
        z = [nearest_latent(decoder, target, code) for target, code in zip((now, before), codes, strict=True)]
        return State(z[0], z[1], now, before)


@dataclass(frozen=True, eq=False)
class Solid:
    """A finished run, open for measuring."""

    name: str
    scene: Scene
    U: Array
    model: tuple[Decoder, Encoder]
    header: Header
    options: TrainOptions
    snapshots: Snapshots
    synthetic: Array
    cubature: CubatureRule | None

    def coordinates(self, names: list[str]) -> Array:
        """q of all frames of some motions, (N, k)."""
        metric = inner_product(self.scene.mass, "mass")
        return all_coordinates(lambda: self.snapshots.chunks(names), metric, self.U)

    def linear(self, k: int) -> Space:
        narrow = np.ascontiguousarray(self.U[:, :k])
        return Space(f"linear {k}", EveryElement(self.scene, narrow, Decoder.identity(k)), Encoder((), ()))

    def latent(self, r: int) -> Space:
        """The run's autoencoder; of another size one that is trained here with the settings of the run."""
        decoder, encoder = self.model if r == self.model[0].r else self._trained(r)
        return Space(f"latent {r}", EveryElement(self.scene, self.U, decoder), encoder)

    def _trained(self, r: int) -> tuple[Decoder, Encoder]:
        options, names = self.options, self.snapshots.with_role("train")
        q, forces = self.coordinates(names), None
        if options.equilibrium:
            every, basis = np.concatenate([q, self.synthetic]), Basis.of(self.U, self.scene.mass)
            snapshot = self.snapshots.frame_reader(names)

            def displacement(i: int) -> Array:
                return snapshot(i).astype(np.float64) if i < len(q) else basis.displacement(every[i])

            poses = Poses(every, displacement, lambda i: np.zeros((len(self.U) // 3, 3)))
            forces = pose_forces(self.scene, basis, poses, options.equilibrium.poses, lambda: None)
        trained = train(Examples(np.concatenate([q, self.synthetic]), len(self.synthetic), forces), r, options)
        return trained.decoder, trained.encoder


@contextmanager
def opened(folder: Path) -> Iterator[Solid]:
    """A finished run by its folder."""
    scene, _ = read_scene(folder / "scene.h5")
    stored, header = read_model(folder / "model.h5")
    U = read_basis(folder / "basis.h5")[0].basis.U
    options = TrainOptions.model_validate(yaml.safe_load(header.settings))
    with Snapshots(folder / "snapshots.h5") as snapshots:
        synthetic = np.empty((0, U.shape[1])) if stored.synthetic is None else stored.synthetic.astype(np.float64)
        path = folder / "cubature.h5"
        cubature = read_cubature(path)[0]["latent"].stepped if path.exists() else None
        model = (stored.decoder, stored.encoder)
        yield Solid(folder.name, scene, U, model, header, options, snapshots, synthetic, cubature)


def measure_space(solid: Solid, space: Space, motions: list[str], quick: bool) -> list[Row]:
    """Online errors, and what forces at decoded poses do, on some motions."""
    stepper, rows = space.stepper, []
    every = max(round(WINDOW / solid.scene.time_step), 1)
    for motion in motions:
        recorded = solid.snapshots.recorded(motion)
        frames = min(QUICK_FRAMES, recorded.motion.frames) if quick else recorded.motion.frames
        full, q = solid.snapshots.reader(motion)(0, frames), solid.coordinates([motion])[:frames]

        def restart(frame: int, q: Array = q) -> State | None:
            return space.state(q, frame - 1) if frame > 1 and frame % every == 0 else None

        held, latent = dict(recorded.held), not stepper.decoder.is_identity
        error = online_error(stepper.U, run(stepper, recorded.motion, held, frames), full)
        windowed = online_error(stepper.U, run(stepper, recorded.motion, held, frames, restart), full)
        label, unseen = f"{motion} ({recorded.role}), {space.name}", recorded.role == "heldout"
        goals = (("<= 0.1", "<= 0.05") if unseen else ("<= 0.03", None)) if latent else (None, None)
        rows.append(row(solid.name, f"online error, {label}", error, "", goals[0]))
        rows.append(row(solid.name, f"windowed error, {label}", windowed, "", goals[1]))
        for what, value in forces_at_decoded_poses(space, q, full).items():
            rows.append(row(solid.name, f"{what}, {label}", value))
    return rows


def measure_stepped(solid: Solid, motions: list[str]) -> list[Row]:
    """Online errors of the run's latent space stepped as `ldsim simulate` steps it, with its own cubature."""
    (decoder, encoder), metric, rows = solid.model, inner_product(solid.scene.mass, "mass"), []
    assert solid.cubature is not None
    space = ReducedSpace("latent", solid.U, decoder, encoder, solid.cubature)
    stepper = space.stepper(solid.scene, STOP, 200, Method.BFGS, True)
    for motion in motions:
        recorded, frames = solid.snapshots.recorded(motion), solid.snapshots.reader(motion)
        whole, windowed = errors(solid.scene, space, stepper, recorded, frames, metric)
        label, unseen = f"{motion} ({recorded.role}), stepped {decoder.r}", recorded.role == "heldout"
        rows.append(row(solid.name, f"online error, {label}", whole, "", "<= 0.1" if unseen else "<= 0.03"))
        rows.append(row(solid.name, f"windowed error, {label}", windowed, "", "<= 0.05" if unseen else None))
    return rows


def online_error(U: Array, q: Array, full: NDArray[np.float32]) -> float:
    """Mean vertex distance over mean displacement; infinite where the run was lost."""
    distance = moved = 0.0
    for start in range(0, len(q), 64):
        u = full[start : start + len(q[start : start + 64])].astype(np.float64)
        distance += float(np.linalg.norm((q[start : start + 64] @ U.T).reshape(u.shape) - u, axis=2).sum())
        moved += float(np.linalg.norm(u, axis=2).sum())
    return distance / moved if np.isfinite(distance) else np.inf


def forces_at_decoded_poses(space: Space, q: Array, full: NDArray[np.float32]) -> dict[str, float]:
    """Medians over poses: relative shift of the equilibrium, mismatch of the projected forces, ratio of energies."""
    stepper, decoder = space.stepper, space.stepper.decoder
    k = decoder.k
    result = []
    for frame in np.linspace(5, len(q) - 1, min(POSES, len(q) - 5)).astype(int):
        u = full[frame].astype(np.float64)
        z = nearest_latent(decoder, q[frame, :k], space.encoder(q[frame : frame + 1, :k])[0])
        J = np.eye(k) if decoder.is_identity else decoder.jacobian(z)
        true = np.zeros_like(u)
        energy = add_elastic_gradient(stepper.scene.elements, u, true)
        decoded, force = stepper.force(decoder(z))
        there = J.T @ (stepper.U.T @ true.ravel())
        difference = J.T @ force - there
        shift = J @ np.linalg.solve(J.T @ stepper.stiffness(u) @ J, difference)
        result.append(
            (
                np.linalg.norm(shift) / np.linalg.norm(q[frame, :k]),
                np.linalg.norm(difference) / np.linalg.norm(there),
                decoded / energy,
            )
        )
    names = ("equilibrium shift", "force mismatch", "energy ratio")
    return dict(zip(names, np.median(np.array(result), axis=0).tolist(), strict=True))


def measure_pca(quick: bool) -> list[Row]:
    """Processor seconds, on one thread, of the streamed basis of 29 and of one from a Gram matrix in memory."""
    size, frames = (25_000, 200) if quick else (250_000, 1000)
    rng = np.random.default_rng(0)
    modes = rng.normal(size=(60, size)).astype(np.float32) * 0.85 ** np.arange(60, dtype=np.float32)[:, None]
    size -= size % 3
    data = (rng.normal(size=(frames, 60)).astype(np.float32) @ modes)[:, :size]
    with tempfile.TemporaryDirectory() as folder, h5py.File(Path(folder) / "data.h5", "w") as file:
        stored = file.create_dataset("u", data=data, chunks=(1, size))
        started = time.process_time()
        _, vectors = eigh(data @ data.T)
        np.linalg.qr(data.T @ vectors[:, -29:])
        plain = time.process_time() - started
        del data
        rows = max((128 << 20) // (4 * size), 1)
        identity = csr_array(eye_array(size // 3))
        started = time.process_time()
        leading_modes(lambda: (stored[i : i + rows] for i in range(0, frames, rows)), identity, 29)
        streamed = time.process_time() - started
    return [
        row("synthetic", f"pca, {size:,} × {frames:,}, in memory", plain, "CPU s"),
        row("synthetic", f"pca, {size:,} × {frames:,}, streamed", streamed, "CPU s"),
        row("synthetic", "pca, streamed over in memory", streamed / plain, "", "<= 2"),
    ]


def row(model: str, quantity: str, value: float | None, unit: str = "", goal: str | None = None) -> Row:
    """A row of the results; null for what was lost."""
    value = value if value is None or np.isfinite(value) else None
    return {"model": model, "quantity": quantity, "value": value, "unit": unit, "goal": goal}
