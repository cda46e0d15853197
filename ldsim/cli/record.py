"""`ldsim record`: pull a coarse mesh in the browser and record a motion."""

from __future__ import annotations

from pathlib import Path

import click

from ldsim.cli.parameters import browser_option, port_option, until_closed_option
from ldsim.cli.stage import Bars, flags_of
from ldsim.options import checked_options
from ldsim.settings.record import RecordOptions, recording_scene
from ldsim.viewer.playground import record_server
from ldsim.viewer.serving import serve


@click.command("record", help="Pull the solid of a configuration, or of a MESH or surface file, and record it.")
@click.argument("source", metavar="CONFIG|MESH", type=click.Path(path_type=Path))
@flags_of(RecordOptions)
@port_option
@browser_option
@until_closed_option
def command(source: Path, port: int, browser: bool, until_closed: bool, **flags: object) -> None:
    options = checked_options(flags, "options of record", RecordOptions)
    progress = Bars()
    with progress.opening(f"{source}"):
        scene, recorder = recording_scene(source, options, progress)
        server = record_server(scene, source.stem, recorder, port, until_closed)
    serve(server, browser, click.echo, progress.tell)
