"""`ldsim open`: the report of a run, in the browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import click

from ldsim.cli.parameters import browser_option, run_argument
from ldsim.report.overview import page_of


@click.command("open", help="Open the report of a RUN, such as runs/demo, in the browser.")
@run_argument
@browser_option
def command(run: Path, browser: bool) -> None:
    page = page_of(run)
    click.echo(str(page))
    if browser and not webbrowser.open(page.as_uri()):
        click.echo("no browser was found; open this file in one", err=True)
