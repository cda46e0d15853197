"""`ldsim make`: run what is missing or stale of a configuration, from the mesh to the report."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from ldsim import __version__
from ldsim.report.overview import missed
from ldsim.run import Run
from ldsim.settings import STAGES, load_settings
from ldsim.settings.make import MISSED, StageFailed, Staleness, made_by, make


@click.command("make", help="Run what is missing or stale of a configuration, from the mesh to the report.")
@click.version_option(__version__, "--version", prog_name="ldsim")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--runs", type=click.Path(path_type=Path), default=Path("runs"), help="Folder of all runs.")
@click.option("--until", type=click.Choice(STAGES), default=STAGES[-1], show_default=True, help="The last stage.")
@click.option("--error", type=float, metavar="PERCENT", help="End with status 3 unless the stated error is within it.")
@click.option("-n", "--dry-run", is_flag=True, help="Only say what would run, and why.")
@click.option("--experiment", help="Refuse a configuration of another experiment (for the Makefile).")
def command(config: Path, runs: Path, until: str, error: float | None, dry_run: bool, experiment: str | None) -> None:
    settings = load_settings(config, experiment)
    run = Run(runs / settings.experiment, settings.experiment)
    if dry_run:
        for stage, reason in Staleness(run, settings, config.parent).stale(until).items():
            click.echo(f"{stage}: {reason}")
        return
    try:
        ran = make(config, runs, until, click.echo)
    except StageFailed as failed:
        sys.exit(failed.status)
    said = "" if ran else f"nothing to do, {run.experiment} is up to date: "
    click.echo(f"{said}{made_by(run, until).resolve()}")
    if error is not None and (words := missed(run.folder, error)):
        click.echo(words, err=True)
        sys.exit(MISSED)
