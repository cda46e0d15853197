"""The stage train: snapshots and a basis → the latent space, an autoencoder or a condensed one."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.artefacts.records import StoredModel, write_model
from ldsim.artefacts.training import PARTIAL, TrainingStore, remove_checkpoints
from ldsim.jit import one_thread
from ldsim.learn.examples import Examples, Poses, pose_forces
from ldsim.learn.options import TrainOptions
from ldsim.learn.search import Searched, search
from ldsim.learn.training import Trained, train_ordered
from ldsim.learn.training import train as train_alone
from ldsim.pipeline.condense import condensed_model
from ldsim.pipeline.progress import SILENT, Bar, Progress
from ldsim.run import Run, Stage
from ldsim.space.novelty import fit_novelty
from ldsim.space.projection import all_coordinates, matching_dimension, reconstruction_error

NO_VALIDATION = "warning: no motion has the role validation, so choices and thresholds rest on the training motions"


def train(
    run: Run, options: TrainOptions = TrainOptions(), progress: Progress = SILENT, keep: bool = False
) -> StoredModel:
    """Train the latent space of a run that has its basis, of the kind that the options name, and write model.h5.

    What was interrupted goes on where it was, and ends as if it had not been, when it is called with the same options.

    Args:
        keep: whether relaxed poses stay on disk, for a call that asks for more of them.

    Raises:
        ArtefactError: scene, snapshots or basis are missing or do not fit each other.
        SolverError: there is nothing to learn, no r meets the tolerance, or the loss is not finite.
    """
    stage, partial = run.stage("train", options), run.folder / PARTIAL
    run.require("scene", "snapshots", "basis")
    options = options.of_solid(run.scene.mesh.n_vertices, 3 * len(run.scene.free))
    if words := options.without_effect():
        progress.tell(words)
    with one_thread():
        q, unseen = (all_coordinates(run.chunks(role), run.basis) for role in ("train", "validation"))
        synthetic = _synthetic(run)
        if options.kind == "condensed":
            every = np.concatenate([q, synthetic])
            model = condensed_model(run, every, _poses(run, every).displacement, options, progress)
            return _write(run, stage, model, options, {}, keep)
        with progress.bar("train", None, "epoch") as bar:
            every, forces, term = np.concatenate([q, synthetic]), None, options.equilibrium
            if term is not None:
                forces = pose_forces(run.scene, run.basis, _poses(run, every), term.poses, bar.update)
            examples = Examples(every, len(synthetic), forces)
            trainer = _Trainer(run, examples, options, partial, bar)
            found = search(trainer, run.basis.k, options.r, options.tolerance_mm / 1e3)
        errors = np.array([trainer.error(found.trained, role) for role in ("train", "validation")])
    if len(unseen) == 0:
        progress.tell(NO_VALIDATION)
    model = _stored(run, examples, unseen, found, errors)
    return _write(run, stage, model, options, {"met": int(found.met)}, keep)


def _write(
    run: Run, stage: Stage, model: StoredModel, options: TrainOptions, notes: dict[str, int], keep: bool
) -> StoredModel:
    """Write model.h5, and remove what an interrupted run would have gone on from, unless it is to be kept."""
    header = stage.header("model", ("snapshots", "basis"), options.seed, activation=options.nonlinearity, **notes)
    write_model(run.path("model"), header, model)
    if not keep:
        remove_checkpoints(run.folder / PARTIAL)
    run.written("model")
    return model


def _stored(run: Run, examples: Examples, unseen: Array, found: Searched, errors: Array) -> StoredModel:
    trained = found.trained
    return StoredModel(
        decoder=trained.decoder,
        encoder=trained.encoder,
        loss=trained.loss,
        search=np.array([[each.r, 1e3 * each.largest, 1e3 * each.mean] for each in found.tried]),
        errors=errors,
        kp=matching_dimension(run.pca.max_error, errors[0, 0]),
        best_epoch=trained.best_epoch,
        search_own=np.array([each.own for each in found.tried]),
        novelty=fit_novelty(trained.decoder, trained.encoder, examples.q, unseen),
    )


def _synthetic(run: Run) -> Array:
    """Coordinates of the frames of synthetic motions that were made with the basis, (f, k)."""
    made = run.pca.synthetic
    return np.empty((0, run.basis.k)) if made is None else made.astype(np.float64)


def _poses(run: Run, q: Array) -> Poses:
    """The snapshots of the training motions, and after them the synthetic frames, where all pins are at rest."""
    names = run.snapshots.with_role("train")
    recorded = run.lifting.all_coordinates([run.recorded(name).motion for name in names])
    a = np.zeros((len(q), run.lifting.count))
    a[: len(recorded)] = recorded
    snapshot = run.snapshots.frame_reader(names)

    def displacement(number: int) -> Array:
        return snapshot(number).astype(np.float64) if number < len(recorded) else run.basis.displacement(q[number])

    return Poses(q, displacement, lambda number: (run.lifting.fields @ a[number]).reshape(-1, 3))


class _Trainer:
    """The trainings of a search, each with its checkpoint; the ordered one is made once."""

    def __init__(self, run: Run, examples: Examples, options: TrainOptions, partial: Path, bar: Bar) -> None:
        self._run, self._examples, self._options, self._partial, self._bar = run, examples, options, partial, bar
        self._ordered: Callable[[int], Trained] | None = None

    def alone(self, r: int) -> Trained:
        """A training of one size."""
        return train_alone(self._examples, r, self._options, self._watch(f"r = {r}"), self._store(f"r{r}"))

    def leading(self, r: int) -> Trained:
        """The leading codes of the ordered training, which is as large as the first that is asked for."""
        if self._ordered is None:
            watch, store = self._watch(f"up to r = {r}"), self._store(f"ordered{r}")
            self._ordered = train_ordered(self._examples, r, self._options, watch, store)
        return self._ordered(r)

    def error(self, trained: Trained, role: str = "train") -> tuple[float, float]:
        """Largest and mean vertex error over the snapshots of a role, metres."""
        return reconstruction_error(self._run.chunks(role), self._run.basis, trained.encoder, trained.decoder)

    def _watch(self, what: str) -> Callable[[int, float, float], None]:
        def show(epoch: int, training: float, validation: float) -> None:
            self._bar.say(f"{what}: loss {training:.2e}, validation {validation:.2e}")
            self._bar.update()

        return show

    def _store(self, name: str) -> TrainingStore:
        """Where a training of these very examples and options keeps its checkpoint."""
        given = self._examples
        digest = hashlib.sha256(given.q.tobytes() + f"{name} {self._options} {given.synthetic}".encode())
        for array in () if given.forces is None else (given.forces.stiffness, given.forces.excess):
            digest.update(array.tobytes())
        return TrainingStore(self._partial, name, digest.hexdigest())
