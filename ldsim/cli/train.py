"""`ldsim train`: train the latent space."""

from __future__ import annotations

import click

from ldsim.cli.stage import Call, stage_command
from ldsim.pipeline.train import train

KEEP = click.Option(["--keep"], is_flag=True, help="Keep relaxed poses, for a call that asks for more.")


@stage_command(
    "train", "Train the latent space, an autoencoder or a condensed one; what was interrupted goes on.", KEEP
)
def command(call: Call, keep: bool = False) -> None:
    model = train(call.run, call.settings.train, call.progress, keep)
    largest, mean = 1e3 * model.errors[0]
    kind = f" of k = {model.decoder.k}" if model.potential is None else ", condensed"
    told = f"vertex error of the training frames {largest:.3g} mm at most, {mean:.2g} mm on average"
    rival = f", as good as PCA-{model.kp}" if model.potential is None else ""
    call.done("model", f"r = {model.decoder.r}{kind}, {told}{rival}")
