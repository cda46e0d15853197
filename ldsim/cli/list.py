"""`ldsim list`: all runs, how far each has come and how good it is."""

from __future__ import annotations

from pathlib import Path

import click

from ldsim.cli.app import printable
from ldsim.cli.parameters import runs_option
from ldsim.report.overview import listed


@click.command("list", help="All runs: how far each has come, and how good it is.")
@runs_option
def command(runs: Path) -> None:
    for line in listed(runs):
        click.echo(printable(line))
