"""`ldsim play`: pull a finished run in the browser."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from ldsim.cli.parameters import browser_option, port_option, run_argument, until_closed_option
from ldsim.cli.stage import Bars
from ldsim.viewer.playground import play_server
from ldsim.viewer.serving import serve

AUTO = ("auto",)


@click.command("play", help="Pull the solid of a finished RUN, such as runs/demo, in the browser.")
@run_argument
@click.option(
    "--space",
    "spaces",
    type=click.Choice(["auto", "latent", "linear", "full"]),
    multiple=True,
    default=AUTO,
    show_default=True,
    help="What to show at first; several stand side by side. auto: what simulate chose for this solid.",
)
@port_option
@browser_option
@until_closed_option
def command(run: Path, spaces: tuple[str, ...], port: int, browser: bool, until_closed: bool) -> None:
    pull_at(run, spaces, port, browser, until_closed)


def pull_at(
    run: Path, spaces: Sequence[str] = AUTO, port: int = 0, browser: bool = True, until_closed: bool = False
) -> None:
    """Serve the page of a finished run until it is interrupted or closed: what `ldsim make --play` ends in, too."""
    progress = Bars()
    with progress.opening(f"{run}"):
        server = play_server(run, spaces, port, until_closed)
    serve(server, browser, click.echo, progress.tell)
