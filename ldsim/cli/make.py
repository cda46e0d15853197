"""`ldsim make`: run what is missing or stale of a configuration, from the mesh to the report."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from ldsim.cli.parameters import Percent, on_configuration
from ldsim.cli.play import pull_at
from ldsim.report.overview import missed
from ldsim.run import Run
from ldsim.settings import STAGES, load_settings
from ldsim.settings.enrich import current, enrich
from ldsim.settings.make import MISSED, StageFailed, Staleness, made_by, make


@on_configuration("make", "Run what is missing or stale of a configuration, from the mesh to the report.")
@click.option("--until", type=click.Choice(STAGES), default=STAGES[-1], show_default=True, help="The last stage.")
@click.option("--error", type=Percent(), metavar="PERCENT", help="Learn until it is held; status 3 where it is not.")
@click.option("--minutes", type=click.FloatRange(min=0), default=20.0, show_default=True, help="Begin no round later.")
@click.option("--step", type=click.FloatRange(min=0), metavar="MICROSECONDS", help="Status 3 where a step is slower.")
@click.option("--play", is_flag=True, help="Then pull the solid in the browser, as `ldsim play` does.")
@click.option("-n", "--dry-run", is_flag=True, help="Only say what would run, and why.")
@click.option("--experiment", help="Refuse a configuration of another experiment (for the Makefile).")
def command(
    config: Path, runs: Path, until: str, play: bool, dry_run: bool, experiment: str | None, **asked: float | None
) -> None:
    settings = load_settings(current(config), experiment)
    run = Run(runs / settings.experiment, settings.experiment)
    if dry_run:
        stale = Staleness(run, settings, config.parent).stale(until).items()
        click.echo("".join(f"{stage}: {reason}\n" for stage, reason in stale), nl=False)
        return
    try:
        enrich(config, runs, asked["error"], asked["minutes"], click.echo)
        ran = make(current(config), runs, until, click.echo)
    except StageFailed as failed:
        sys.exit(failed.status)
    click.echo(("" if ran else f"nothing to do, {run.experiment} is up to date: ") + f"{made_by(run, until).resolve()}")
    if words := missed(run.folder, asked["error"], asked["step"]):
        click.echo("\n".join(words), err=True)
    if play:
        pull_at(run.folder)
    sys.exit(MISSED if words else 0)
