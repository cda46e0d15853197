"""`ldsim make`: run what is missing or stale of a configuration, from the mesh to the report."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import click

from ldsim import __version__
from ldsim.report.overview import missed
from ldsim.run import Run
from ldsim.settings import STAGES, load_settings
from ldsim.settings.enrich import current, enrich
from ldsim.settings.make import MISSED, StageFailed, Staleness, made_by, make


class Percent(click.ParamType[float]):
    """A share above 0, said in percent, with or without the sign."""

    name = "percent"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            found = float(str(value).strip().removesuffix("%"))
        except ValueError:
            found = 0.0
        if not 0 < found < math.inf:
            self.fail(f"{value!r} is no percentage above 0, such as 5 or 5%", param, ctx)
        return found


PERCENT = Percent()


@click.command("make", help="Run what is missing or stale of a configuration, from the mesh to the report.")
@click.version_option(__version__, "--version", prog_name="ldsim")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--runs", type=click.Path(path_type=Path), default=Path("runs"), help="Folder of all runs.")
@click.option("--until", type=click.Choice(STAGES), default=STAGES[-1], show_default=True, help="The last stage.")
@click.option("--error", type=PERCENT, metavar="PERCENT", help="Learn until it is held; status 3 where it is not.")
@click.option("--minutes", type=click.FloatRange(min=0), default=20.0, show_default=True, help="Begin no round later.")
@click.option("--step", type=click.FloatRange(min=0), metavar="MICROSECONDS", help="Status 3 where a step is slower.")
@click.option("-n", "--dry-run", is_flag=True, help="Only say what would run, and why.")
@click.option("--experiment", help="Refuse a configuration of another experiment (for the Makefile).")
def command(config: Path, runs: Path, until: str, dry_run: bool, experiment: str | None, **asked: float | None) -> None:
    settings = load_settings(current(config), experiment)
    run = Run(runs / settings.experiment, settings.experiment)
    if dry_run:
        for stage, reason in Staleness(run, settings, config.parent).stale(until).items():
            click.echo(f"{stage}: {reason}")
        return
    error, minutes = asked["error"], asked["minutes"]
    try:
        if error is not None and minutes is not None:
            enrich(config, runs, error / 100, 60 * minutes, click.echo)
        ran = make(current(config), runs, until, click.echo)
    except StageFailed as failed:
        sys.exit(failed.status)
    said = "" if ran else f"nothing to do, {run.experiment} is up to date: "
    click.echo(f"{said}{made_by(run, until).resolve()}")
    words = missed(run.folder, error, asked["step"])
    for line in words:
        click.echo(line, err=True)
    if words:
        sys.exit(MISSED)
