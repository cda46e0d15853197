"""`ldsim settings`: check a configuration, print it with defaults, or keep the stamps that make compares."""

from __future__ import annotations

from pathlib import Path

import click

from ldsim import __version__
from ldsim.errors import SettingsError
from ldsim.pipeline.solid import solid_of
from ldsim.run import Run
from ldsim.settings import load_settings, write_stamps


@click.command("settings", help="Check a configuration and print it with defaults.")
@click.version_option(__version__, "--version", prog_name="ldsim")
@click.argument("config", type=click.Path(path_type=Path))
@click.option(
    "--stamps",
    type=click.Path(path_type=Path),
    help="Instead, write one file a stage with all it depends on, touching only those that changed (for make).",
)
@click.option("--experiment", help="Refuse a configuration of another experiment (for make).")
@click.option("--runs", type=click.Path(path_type=Path), default=Path("runs"), help="Folder of all runs.")
def command(config: Path, stamps: Path | None, experiment: str | None, runs: Path) -> None:
    settings = load_settings(config)
    if experiment not in (None, settings.experiment):
        raise SettingsError(
            f"configuration {config}: experiment is {settings.experiment!r}, expected {experiment!r}; make finds the "
            "files of an experiment by the name of its configuration"
        )
    if stamps is None:
        click.echo(settings.dump(), nl=False)
        for line in solid_of(Run(runs / settings.experiment), settings.mesh, settings.snapshot, config.parent):
            click.echo(f"# {line}")
    else:
        write_stamps(settings, config.parent, stamps)
