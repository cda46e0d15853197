"""`ldsim train`: train the autoencoder."""

from __future__ import annotations

from ldsim.cli.stage import Call, stage_command
from ldsim.pipeline.train import train


@stage_command("train", "Train the autoencoder in PCA coordinates; interrupted, it goes on where it was.")
def command(call: Call) -> None:
    model = train(call.run, call.settings.train, call.progress)
    largest, mean = 1e3 * model.errors[0]
    call.done(
        "model",
        f"r = {model.decoder.r} of k = {model.decoder.k}, vertex error of the training frames {largest:.3g} mm at "
        f"most, {mean:.2g} mm on average, as good as PCA-{model.kp}",
    )
