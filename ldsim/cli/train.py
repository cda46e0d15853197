"""`ldsim train`: train the latent space."""

from __future__ import annotations

from ldsim.cli.stage import Call, stage_command
from ldsim.pipeline.train import train


@stage_command("train", "Train the latent space, an autoencoder or a condensed one; what was interrupted goes on.")
def command(call: Call) -> None:
    model = train(call.run, call.settings.train, call.progress)
    largest, mean = 1e3 * model.errors[0]
    kind = f"of k = {model.decoder.k}" if model.potential is None else "condensed"
    told = f"vertex error of the training frames {largest:.3g} mm at most, {mean:.2g} mm on average"
    rival = f", as good as PCA-{model.kp}" if model.potential is None else ""
    call.done("model", f"r = {model.decoder.r} {kind}, {told}{rival}")
