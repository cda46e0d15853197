"""`ldsim settings`: check a configuration, print it with defaults, and say what the solid does."""

from __future__ import annotations

from pathlib import Path

import click

from ldsim.cli.parameters import on_configuration
from ldsim.pipeline.solid import solid_of
from ldsim.run import Run
from ldsim.settings import load_settings


@on_configuration("settings", "Check a configuration and print it with defaults.")
def command(config: Path, runs: Path) -> None:
    settings = load_settings(config)
    click.echo(settings.dump(), nl=False)
    if words := settings.train.without_effect():
        click.echo(f"# {words}")
    for line in solid_of(Run(runs / settings.experiment), settings.mesh, settings.snapshot, config.parent):
        click.echo(f"# {line}")
