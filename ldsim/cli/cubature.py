"""`ldsim cubature`: choose the cubature points of the latent space and of linear ones."""

from __future__ import annotations

import click

from ldsim.cli.stage import Call, stage_command
from ldsim.pipeline.cubature import cubature, summary
from ldsim.settings.make import MISSED


@stage_command("cubature", "Choose the cubature points of the latent space and of linear ones.")
def command(call: Call) -> None:
    options = call.settings.cubature
    found = cubature(call.run, options, call.progress)
    call.done("cubature", summary(found))
    if not all(path.meets(options.tolerance) for path in found.values()):
        raise click.exceptions.Exit(MISSED)
