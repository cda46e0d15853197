"""`ldsim train`: train the autoencoder."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Never

import click
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ldsim.artefacts.records import StoredModel, read_basis, read_scene, write_model
from ldsim.artefacts.snapshots import Snapshots
from ldsim.artefacts.training import TrainingStore, remove_checkpoints
from ldsim.cli.stage import Run, progress_bar, stage_command
from ldsim.dynamics.synthetic import rehearsal_stepper, rehearse
from ldsim.jit import one_thread
from ldsim.learn import Forces, Trained, TrainingOptions, train, train_ordered
from ldsim.learn.equilibrium import spread_forces
from ldsim.learn.search import search
from ldsim.mechanics.pulls import surface_pulls
from ldsim.mechanics.scene import Scene
from ldsim.settings import TrainSettings
from ldsim.space.basis import Basis
from ldsim.space.lifting import Lifting
from ldsim.space.novelty import fit_novelty
from ldsim.space.pca import Chunks
from ldsim.space.projection import all_coordinates, matching_dimension, reconstruction_error

# Pulls of a rehearsal that are run one after another; then the solid is at rest again.
PULLS_TOGETHER = 10
NO_HELDOUT = "warning: no motion has the role heldout, so nothing tells how the model does on unseen motions"


@stage_command("train", "Train the autoencoder in PCA coordinates; interrupted, it goes on where it was.")
def command(run: Run) -> None:
    settings = run.settings.train
    scene, _ = read_scene(run.path("scene"))
    stored, header = read_basis(run.path("basis"), scene)
    run.check("basis", header, "scene", "snapshots")
    basis, U, partial = stored.basis, stored.basis.matrix, run.folder / "model.partial"
    with Snapshots(run.path("snapshots")) as snapshots, one_thread():
        motions = {name: snapshots.recorded(name).motion for name in snapshots.names}
        lifting = Lifting.of(scene, motions.values())

        def chunks(role: str) -> Chunks:
            names = snapshots.with_role(role)
            return lifting.taken_off(lambda: snapshots.chunks(names), [motions[name] for name in names])

        def error(trained: Trained, role: str = "train") -> tuple[float, float]:
            return reconstruction_error(chunks(role), basis, trained.encoder, trained.decoder)

        q, unseen = (all_coordinates(chunks(role), basis) for role in ("train", "heldout"))
        rehearsed = _rehearsed(scene, basis, q, settings, partial)
        with progress_bar(None, "train", "epoch") as bar:
            forces = None
            if settings.equilibrium:
                a = lifting.all_coordinates([motions[name] for name in snapshots.with_role("train")])
                forces = spread_forces(
                    *(scene, U, q, chunks("train"), rehearsed, settings.equilibrium_poses, bar.update),
                    lambda t: lifting.fields @ a[t],
                )
            every = np.concatenate([q, rehearsed])
            trainings = _Trainings(every, len(q), settings, forces, partial, bar)
            most = settings.tolerance_mm / 1e3
            found = search(U.shape[1], settings.r, trainings.alone, trainings.leading, error, most)
        errors = np.array([error(found.trained), error(found.trained, "heldout")])
    trained = found.trained
    novelty = fit_novelty(trained.decoder, trained.encoder, every, unseen)
    kp = matching_dimension(stored.max_error, errors[0, 0])
    model = StoredModel(
        *(trained.decoder, trained.encoder, trained.loss, found.tried, errors, kp, trained.best_epoch, found.own),
        *(novelty, rehearsed.astype(np.float32) if len(rehearsed) else None),
    )
    header = run.header(
        "model", "train", ("snapshots", "basis"), seed=settings.seed, activation=settings.activation, met=int(found.met)
    )
    write_model(run.path("model"), header, model)
    remove_checkpoints(partial)
    run.done(
        "model",
        f"r = {trained.decoder.r} of k = {trained.decoder.k}, vertex error of the training frames "
        f"{1e3 * errors[0, 0]:.3g} mm at most, {1e3 * errors[0, 1]:.2g} mm on average, as good as PCA-{kp}",
    )
    if len(unseen) == 0:
        click.echo(NO_HELDOUT, err=True)


def _rehearsed(
    scene: Scene, basis: Basis, q: NDArray[np.float64], settings: TrainSettings, folder: Path
) -> NDArray[np.float64]:
    """Coordinates of the rehearsed pulls, (f, k) in what float32 holds; kept until the model is written."""
    if settings.rehearsal is None:
        return np.empty((0, basis.k))
    digest = hashlib.sha256(q.tobytes() + basis.matrix.tobytes() + repr(settings.rehearsal).encode())
    store = TrainingStore(folder, "rehearsal", digest.hexdigest())
    kept = store.load()
    if kept is None:
        motion = surface_pulls("rehearsal", scene, settings.rehearsal)
        with progress_bar(None, "train: cubature of the rehearsal", "set") as bar:

            def show(points: int, error: float) -> None:
                bar.set_postfix_str(f"{points} points, relative error {error:.3f}", refresh=False)
                bar.update()

            stepper = rehearsal_stepper(scene, basis, q, settings.rehearsal.seed, show)
        with progress_bar(motion.frames, "train: rehearsal", "frame") as bar:
            part = PULLS_TOGETHER * (settings.rehearsal.frames + settings.rehearsal.rest)
            made = rehearse(stepper, motion, bar.update, part)
        if len(made) < motion.frames:
            click.echo(f"warning: the rehearsal lost {motion.frames - len(made)} of {motion.frames} frames", err=True)
        kept = {"q": made.astype(np.float32)}
        store.save(kept)
    return kept["q"].astype(np.float64)


class _Trainings:
    """The trainings of a search, each with its checkpoint; the ordered one is made once."""

    def __init__(
        self,
        q: NDArray[np.float64],
        recorded: int,
        settings: TrainSettings,
        forces: Forces | None,
        folder: Path,
        bar: tqdm[Never],
    ) -> None:
        self._q, self._recorded, self._forces, self._folder, self._bar = q, recorded, forces, folder, bar
        names = {field.name for field in fields(TrainingOptions)}
        self._options = TrainingOptions(**settings.model_dump(include=names))
        self._ordered: Callable[[int], Trained] | None = None

    def alone(self, r: int) -> Trained:
        """A training of one size."""
        self._bar.set_description(f"train r = {r}")
        return train(self._q, r, self._options, self._show, self._forces, self._store(f"r{r}"), self._recorded)

    def leading(self, r: int) -> Trained:
        """The leading codes of the ordered training, which is as large as the first that is asked for."""
        if self._ordered is None:
            self._bar.set_description(f"train up to r = {r}")
            store = self._store(f"ordered{r}")
            self._ordered = train_ordered(self._q, r, self._options, self._show, store, self._recorded)
        return self._ordered(r)

    def _show(self, epoch: int, training: float, validation: float) -> None:
        self._bar.set_postfix_str(f"loss {training:.2e}, validation {validation:.2e}", refresh=False)
        self._bar.update()

    def _store(self, name: str) -> TrainingStore:
        """Where a training of these very data and options keeps its checkpoint."""
        digest = hashlib.sha256(self._q.tobytes() + f"{name} {self._options} {self._recorded}".encode())
        for array in () if self._forces is None else (self._forces.stiffness, self._forces.excess):
            digest.update(array.tobytes())
        return TrainingStore(self._folder, name, digest.hexdigest())
