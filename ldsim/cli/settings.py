"""`ldsim settings`: check a configuration, print it with defaults, and say what the solid does."""

from __future__ import annotations

from pathlib import Path

import click

from ldsim import __version__
from ldsim.pipeline.solid import solid_of
from ldsim.run import Run
from ldsim.settings import load_settings


@click.command("settings", help="Check a configuration and print it with defaults.")
@click.version_option(__version__, "--version", prog_name="ldsim")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--runs", type=click.Path(path_type=Path), default=Path("runs"), help="Folder of all runs.")
def command(config: Path, runs: Path) -> None:
    settings = load_settings(config)
    click.echo(settings.dump(), nl=False)
    for line in solid_of(Run(runs / settings.experiment), settings.mesh, settings.snapshot, config.parent):
        click.echo(f"# {line}")
