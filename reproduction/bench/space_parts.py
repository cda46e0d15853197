"""What space.py measures: one space of a finished run on all of its motions, and the streamed PCA."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse import csr_array, eye_array

from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.trajectory import Trajectory
from ldsim.learn.options import TrainOptions
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.pipeline.train import train
from ldsim.run import Run
from ldsim.space.pca import leading_modes
from ldsim.space.space import Space
from reproduction.harness import Row, linked, row
from reproduction.reduced_runs import WINDOW, latent, played, reference
from reproduction.rivals.every_element import EveryElement

POSES = 20
# Of the reduced steps, N: 10⁻⁷ of h² times the potential, the loosest of the authors' code.
STOP = ReducedOptions(tolerance=4e-3)
QUICK_FRAMES = 60


def latent_of(run: Run, r: int, made: Path) -> Space:
    """The run's autoencoder; of another size one that is trained in `made`, with the settings of the run."""
    if r == run.model.decoder.r:
        return latent(run)
    folder = linked(run.folder, made / f"r{r}", ("scene", "snapshots", "basis"))
    with Run(folder, run.experiment) as other:
        if not other.path("model").exists():
            options = TrainOptions.model_validate(yaml.safe_load(run.header("model").settings))
            train(other, options.replace(r=r))
        return latent(other)


def measure_space(run: Run, space: Space, motions: list[str], quick: bool) -> list[Row]:
    """Online errors, and what forces at decoded poses do, on some motions; every element is integrated."""
    stepper, rows, kind = EveryElement(space), [], f"{space.name} {space.r}"
    for motion in motions:
        full = reference(run, motion, QUICK_FRAMES if quick else None)
        rows += _online(run, motion, kind, played(stepper, full, WINDOW), judged=space.name == "latent")
        label = f"{motion} ({run.recorded(motion).role}), {kind}"
        u = run.snapshots.reader(motion)(0, full.motion.frames)
        for what, value in forces_at_decoded_poses(stepper, u).items():
            rows.append(row(run.experiment, f"{what}, {label}", value))
    return rows


def measure_stepped(run: Run, motions: list[str]) -> list[Row]:
    """Online errors of the run's latent space stepped as `ldsim simulate` steps it, with its own cubature rule."""
    space, rows = run.space("latent"), []
    stepper = ReducedStepper(space, STOP)
    for motion in motions:
        judged = played(stepper, reference(run, motion), WINDOW)
        rows += _online(run, motion, f"stepped {space.r}", judged, judged=True)
    return rows


def _online(run: Run, motion: str, kind: str, found: Trajectory, judged: bool) -> list[Row]:
    role = run.recorded(motion).role
    label, goals = f"{motion} ({role}), {kind}", ("<= 0.1", "<= 0.05") if role != "train" else ("<= 0.03", None)
    whole, windowed = goals if judged else (None, None)
    return [
        row(run.experiment, f"online error, {label}", found.relative_error, "", whole),
        row(run.experiment, f"windowed error, {label}", found.windowed_error, "", windowed),
    ]


def forces_at_decoded_poses(stepper: EveryElement, full: NDArray[np.floating]) -> dict[str, float]:
    """Medians over poses: relative shift of the equilibrium, mismatch of the projected forces, ratio of energies.

    Args:
        full: displacements of the full space, (N, n, 3), metres.
    """
    space, decoder, result = stepper.space, stepper.decoder, []
    for frame in np.linspace(5, len(full) - 1, min(POSES, len(full) - 5)).astype(int):
        u = full[frame].astype(np.float64)
        (z,), (q,) = space.encode(u[None])
        J = np.eye(decoder.k) if decoder.is_identity else decoder.jacobian(z)
        true = np.zeros_like(u)
        energy = add_elastic_gradient(space.scene.elements, u, true)
        decoded, force = stepper.force(decoder(z))
        there = J.T @ (space.reduced_basis.matrix.T @ true.ravel())
        difference = J.T @ force - there
        shift = J @ np.linalg.solve(J.T @ stepper.stiffness(u) @ J, difference)
        relative = np.linalg.norm(shift) / np.linalg.norm(q), np.linalg.norm(difference) / np.linalg.norm(there)
        result.append((*relative, decoded / energy))
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
