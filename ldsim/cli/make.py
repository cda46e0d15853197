"""`ldsim make`: run what is missing or stale of a configuration, from the mesh to the report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ldsim.cli import play
from ldsim.cli.parameters import asked_options, on_configuration
from ldsim.report.overview import missed
from ldsim.run import Run
from ldsim.settings import STAGES, load_settings
from ldsim.settings.enrich import BEFORE, current, learn, planned
from ldsim.settings.make import MISSED, StageFailed, Staleness, nothing_to_do, up_to


@on_configuration("make", "Run what is missing or stale of a configuration, from the mesh to the report.")
@click.option("--until", type=click.Choice(STAGES), default=STAGES[-1], show_default=True, help="The last stage.")
@asked_options
@click.option("--play", "pull", is_flag=True, help="Then pull the solid in the browser, as `ldsim play` does.")
@click.option("-n", "--dry-run", is_flag=True, help="Only say what would run, and why.")
def command(config: Path, runs: Path, until: str, pull: bool, dry_run: bool, **asked: Any) -> None:
    settings = load_settings(current(config), asked["experiment"])
    run = Run(runs / settings.experiment, settings.experiment)
    learning = config, runs, None if until in up_to(BEFORE) else asked["error"], asked["minutes"]
    if dry_run:
        click.echo(Staleness(run, settings, config.parent).told(until) + planned(*learning), nl=False)
        return
    try:
        ran = learn(*learning, until, click.echo)
    except StageFailed as failed:
        raise SystemExit(failed.status) from None
    click.echo("" if ran else nothing_to_do(run, until), nl=False)
    if words := missed(run.folder, asked["error"], asked["step"]) if until == STAGES[-1] else []:
        click.echo("\n".join(words), err=True)
    if pull:
        click.get_current_context().invoke(play.command, run=run.folder)
    raise SystemExit(MISSED if words else 0)
