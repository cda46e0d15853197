"""`ldsim play`: pull a finished run in the browser."""

from __future__ import annotations

from pathlib import Path

import click

from ldsim.cli.parameters import browser_option, port_option, run_argument, until_closed_option
from ldsim.cli.stage import Bars
from ldsim.viewer.playground import play_server
from ldsim.viewer.serving import serve


@click.command("play", help="Pull the solid of a finished RUN, such as runs/demo, in the browser.")
@run_argument
@click.option(
    "--space",
    "spaces",
    type=click.Choice(["auto", "latent", "linear", "full"]),
    multiple=True,
    default=("auto",),
    show_default=True,
    help="What to show at first; several stand side by side. auto: what simulate chose for this solid.",
)
@port_option
@browser_option
@until_closed_option
def command(run: Path, spaces: tuple[str, ...], port: int, browser: bool, until_closed: bool) -> None:
    progress = Bars()
    with progress.opening(f"{run}"):
        server = play_server(run, spaces, port, until_closed)
    serve(server, browser, click.echo, progress.tell)
