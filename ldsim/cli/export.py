"""`ldsim export`: write a run's motion or model for other programs."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from ldsim.cli.parameters import Angles, Finite, Size, run_argument
from ldsim.export.formats import FORMATS, Choice, export, megabytes
from ldsim.jit import one_thread
from ldsim.run import AUTO, SPACES, Run
from ldsim.runtime.compilers import PLATFORMS

EPILOG = "\b\nFormats:\n" + "\n".join(f"  {name:12}{entry.meaning}" for name, entry in FORMATS.items())


@click.command("export", help="Write a run's motion or model for other programs.", epilog=EPILOG)
@run_argument
@click.option("--format", "name", metavar="NAME", help="One of the formats below.")
@click.option("--playground", is_flag=True, help="The same as --format playground.")
@click.option("--motion", metavar="NAME", help="Which motion; left out, the run's first.")
@click.option("--space", default=AUTO, show_default=True, metavar="|".join((AUTO, *SPACES)), help="Which space's run.")
@click.option("--every", type=click.IntRange(min=1), default=1, show_default=True, help="Write only every N-th frame.")
@click.option("--platform", "platforms", multiple=True, type=click.Choice([*PLATFORMS]), help="Of c, fmu; repeatable.")
@click.option("--fps", type=Finite(min=0.1), help="Of webp, mp4, webm: frames a second, in real time.")
@click.option("--size", type=Size(), help="Of these: pixels, such as 1280x720.")
@click.option("--view", type=Angles(), help="Of these: azimuth,elevation in degrees, or front, side, top.")
@click.option("--surface", type=click.Path(path_type=Path), help="Draw this file's surface, with its texture.")
@click.option("--output", type=click.Path(path_type=Path), help="File or new folder; left out, RUN/export/….")
def command(run: Path, name: str | None, playground: bool, output: Path | None, **chosen: Any) -> None:
    if playground == (name is not None):
        raise click.UsageError("give --format NAME or --playground")
    started = time.perf_counter()
    with one_thread(), Run.open(run) as opened:
        path, what = export(opened, Choice(name or "playground", **chosen), output)
    click.echo(f"{path}: {what}, {megabytes(path):.1f} MB ({time.perf_counter() - started:.1f} s)")
