"""`ldsim train`: train the autoencoder."""

from __future__ import annotations

from ldsim.cli.stage import Bars, Run, stage_command
from ldsim.pipeline.train import train
from ldsim.run import Run as Artefacts


@stage_command("train", "Train the autoencoder in PCA coordinates; interrupted, it goes on where it was.")
def command(run: Run) -> None:
    model = train(Artefacts(run.folder, run.settings.experiment), run.settings.train, Bars())
    largest, mean = 1e3 * model.errors[0]
    run.done(
        "model",
        f"r = {model.decoder.r} of k = {model.decoder.k}, vertex error of the training frames {largest:.3g} mm at "
        f"most, {mean:.2g} mm on average, as good as PCA-{model.kp}",
    )
