"""`ldsim settings`: check a configuration, print it with defaults, and say what the solid does."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from ldsim.cli.parameters import on_configuration
from ldsim.pipeline.solid import solid_of
from ldsim.run import Run
from ldsim.settings import load_settings
from ldsim.settings.derived import looked_at


@on_configuration("settings", "Check a configuration and print it with defaults.")
def command(config: Path, runs: Path) -> None:
    settings = load_settings(config)
    click.echo(settings.dump(), nl=False)
    if words := settings.train.without_effect():
        click.echo(f"# {words}")
    run = Run(runs / settings.experiment)
    for line in solid_of(run, settings.mesh, partial(looked_at, settings), config.parent):
        click.echo(f"# {line}")
