"""`ldsim new`: look at a solid and write a configuration that fits it."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from ldsim.cli.parameters import RUNS, runs_option
from ldsim.cli.stage import Bars, flags_of
from ldsim.options import checked_options
from ldsim.settings.new import NewOptions, new


@click.command("new", help="Look at a solid, a SURFACE or MESH file or a --shape, and write settings that fit it.")
@click.argument("source", metavar="[SURFACE|MESH]", required=False, type=click.Path(path_type=Path))
@flags_of(NewOptions)
@runs_option
def command(source: Path | None, runs: Path, **flags: object) -> None:
    path, lines = new(source, checked_options(flags, "options of new", NewOptions), runs, Bars())
    for line in lines:
        click.echo(line)
    place = [] if runs == RUNS else ["--runs", str(runs)]
    made = shlex.join(["ldsim", "make", str(path), "--error", "5%", "--play", *place])
    click.echo(f"{path} is written, change in it what you like; then `{made}`")
