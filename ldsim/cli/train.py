"""`ldsim train`: train the autoencoder."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import click
import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import StoredModel, read_basis, read_scene, write_model
from ldsim.artefacts.snapshots import Snapshots
from ldsim.artefacts.training import TrainingStore, remove_checkpoints
from ldsim.cli.stage import Run, progress_bar, stage_command
from ldsim.reduction.autoencoder import Trained, TrainingOptions, train, train_ordered
from ldsim.reduction.latent_search import search
from ldsim.reduction.pca import inner_product
from ldsim.reduction.pose_stiffness import pose_forces, spread_frames
from ldsim.reduction.reconstruction import all_coordinates, matching_dimension, reconstruction_error
from ldsim.reduction.trust import fit_trust
from ldsim.settings import TrainSettings
from ldsim.threads import one_thread

NO_HELDOUT = "warning: no motion has the role heldout, so nothing tells how the model does on unseen motions"


@stage_command("train", "Train the autoencoder in PCA coordinates; interrupted, it goes on where it was.")
def command(run: Run) -> None:
    settings = run.settings.train
    scene, _ = read_scene(run.path("scene"))
    stored, header = read_basis(run.path("basis"))
    run.check("basis", header, "scene", "snapshots")
    U = stored.basis.U
    metric = inner_product(scene.mass, run.settings.pca.inner_product)
    options = _options(settings)
    partial = run.folder / "model.partial"
    poses = settings.equilibrium_poses if settings.equilibrium else 0
    with (
        Snapshots(run.path("snapshots")) as snapshots,
        progress_bar(settings.epochs + poses, "train", "epoch") as bar,
        one_thread(),
    ):
        names = snapshots.with_role("train")

        def error(trained: Trained, role: str = "train") -> tuple[float, float]:
            chosen = snapshots.with_role(role)
            return reconstruction_error(lambda: snapshots.chunks(chosen), metric, U, trained.encoder, trained.decoder)

        def show(epoch: int, training: float, validation: float) -> None:
            bar.set_postfix_str(f"loss {training:.2e}, validation {validation:.2e}", refresh=False)
            bar.n = poses + epoch
            bar.update()

        q = all_coordinates(lambda: snapshots.chunks(names), metric, U)
        frames = spread_frames(len(q), poses)
        forces = pose_forces(scene, U, q, lambda: snapshots.chunks(names), frames, bar.update) if poses else None

        def store(name: str) -> TrainingStore:
            return TrainingStore(partial, name, _identity(q, name, options, poses))

        def alone(size: int) -> Trained:
            bar.set_description(f"train r = {size}")
            return train(q, size, options, show, forces, store(f"r{size}"))

        def leading(size: int) -> Trained:
            if not ordered:
                most = min(U.shape[1], size)
                bar.set_description(f"train up to r = {most}")
                ordered.append(train_ordered(q, most, options, show, store(f"ordered{most}")))
            return ordered[0](size)

        ordered: list[Callable[[int], Trained]] = []
        found = search(U.shape[1], settings.r, alone, leading, error, settings.tolerance_mm / 1e3)
        errors = np.array([error(found.trained), error(found.trained, "heldout")])
        unseen = snapshots.with_role("heldout")
        if not unseen:
            bar.clear()
            click.echo(NO_HELDOUT, err=True)
        others = all_coordinates(lambda: snapshots.chunks(unseen), metric, U)
        trust = fit_trust(found.trained.decoder, found.trained.encoder, q, others)
    trained = found.trained
    kp = matching_dimension(stored.basis.max_error, errors[0, 0])
    model = StoredModel(
        trained.decoder, trained.encoder, trained.loss, found.tried, errors, kp, trained.best_epoch, found.own, trust
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


def _options(settings: TrainSettings) -> TrainingOptions:
    return TrainingOptions(
        hidden=settings.hidden,
        activation=settings.activation,
        epochs=settings.epochs,
        batch=settings.batch,
        learning_rate=settings.learning_rate,
        validation_share=settings.validation_share,
        patience=settings.patience,
        seed=settings.seed,
        balance=settings.balance,
        skip=settings.skip,
        noise=settings.noise,
        variational=settings.variational,
        smoothness=settings.smoothness,
        equilibrium=settings.equilibrium,
        equilibrium_start=settings.equilibrium_start,
        device=settings.device,
    )


def _identity(q: NDArray[np.float64], name: str, options: TrainingOptions, poses: int) -> str:
    """What tells one training from another: its data, its size and its options."""
    text = f"{name} {options} {poses}"
    return hashlib.sha256(q.tobytes() + text.encode()).hexdigest()
