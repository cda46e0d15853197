"""`ldsim train`: train the autoencoder."""

from __future__ import annotations

import numpy as np

from ldsim.artefacts.records import StoredModel, read_basis, read_scene, write_model
from ldsim.artefacts.snapshots import Snapshots
from ldsim.cli.stage import Run, progress_bar, stage_command
from ldsim.reduction.autoencoder import Trained, TrainingOptions
from ldsim.reduction.latent_search import search
from ldsim.reduction.pca import inner_product
from ldsim.reduction.reconstruction import all_coordinates, matching_dimension, reconstruction_error
from ldsim.threads import one_thread


@stage_command("train", "Train the autoencoder in PCA coordinates.")
def command(run: Run) -> None:
    settings = run.settings.train
    scene, _ = read_scene(run.path("scene"))
    stored, header = read_basis(run.path("basis"))
    run.check("basis", header, "scene", "snapshots")
    U = stored.basis.U
    metric = inner_product(scene.mass, run.settings.pca.inner_product)
    options = TrainingOptions(
        settings.hidden,
        settings.activation,
        settings.epochs,
        settings.batch,
        settings.learning_rate,
        settings.validation_share,
        settings.patience,
        settings.seed,
    )
    with Snapshots(run.path("snapshots")) as snapshots, progress_bar(settings.epochs, "train", "epoch") as bar:

        def error(trained: Trained, role: str = "train") -> tuple[float, float]:
            names = snapshots.with_role(role)
            return reconstruction_error(lambda: snapshots.chunks(names), metric, U, trained.encoder, trained.decoder)

        def show(r: int, epoch: int, training: float, validation: float) -> None:
            if epoch == 0:
                bar.reset()
            bar.set_postfix_str(f"r = {r}, loss {training:.2e}, validation {validation:.2e}", refresh=False)
            bar.update()

        names = snapshots.with_role("train")
        q = all_coordinates(lambda: snapshots.chunks(names), metric, U)
        with one_thread():
            found = search(q, settings.r, options, error, settings.tolerance_mm / 1e3, show)
        errors = np.array([error(found.trained), error(found.trained, "heldout")])
    trained = found.trained
    kp = matching_dimension(stored.basis.max_error, errors[0, 0])
    model = StoredModel(trained.decoder, trained.encoder, trained.loss, found.tried, errors, kp, trained.best_epoch)
    header = run.header(
        "model", "train", ("snapshots", "basis"), seed=settings.seed, activation=settings.activation, met=int(found.met)
    )
    write_model(run.path("model"), header, model)
    run.done(
        "model",
        f"r = {trained.decoder.r} of k = {trained.decoder.k}, vertex error of the training frames "
        f"{1e3 * errors[0, 0]:.3g} mm at most, {1e3 * errors[0, 1]:.2g} mm on average, as good as PCA-{kp}",
    )
