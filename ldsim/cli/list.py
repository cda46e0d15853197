"""`ldsim list`: all runs, how far each has come and how good it is."""

from __future__ import annotations

from pathlib import Path

import click

from ldsim import __version__
from ldsim.cli.app import printable
from ldsim.report.overview import listed


@click.command("list", help="All runs: how far each has come, and how good it is.")
@click.version_option(__version__, "--version", prog_name="ldsim")
@click.option("--runs", type=click.Path(path_type=Path), default=Path("runs"), help="Folder of all runs.")
def command(runs: Path) -> None:
    for line in listed(runs):
        click.echo(printable(line))
