"""`ldsim snapshot`: run the motions in the full space."""

from __future__ import annotations

import click

from ldsim.cli.stage import Call, stage_command
from ldsim.pipeline.snapshot import snapshot

SCHEDULER = click.Option(
    ["--scheduler"],
    metavar="ADDRESS",
    help="Dask scheduler to run on, tls://host:8786, instead of this machine (needs ldsim[cluster]).",
)


@stage_command("snapshot", "Run the motions in the full space; interrupted, it goes on where it was.", SCHEDULER)
def command(call: Call, scheduler: str | None = None) -> None:
    found = snapshot(call.run, call.settings.snapshot, call.progress, call.base, scheduler)
    call.done("snapshots", f"{sum(map(found.frames, found.names))} frames of {len(found.names)} motions")
