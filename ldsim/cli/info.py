"""`ldsim info`: what a run came to, or an artefact's header and contents."""

from __future__ import annotations

from pathlib import Path

import click

from ldsim.artefacts.sealed_file import datasets
from ldsim.artefacts.store import read_header, reading
from ldsim.cli.app import printable
from ldsim.report.overview import told


@click.command("info", help="Say what a RUN came to, or print the header and contents of an artefact's FILE.")
@click.argument("file", metavar="RUN|FILE", type=click.Path(path_type=Path))
def command(file: Path) -> None:
    if file.is_dir():
        say("\n".join(told(file)))
        return
    with reading(file) as artefact:
        header = read_header(artefact)
        say(f"{file}: {header.kind}, written by ldsim {header.ldsim_version} on {header.created}")
        for name, value in header.notes.items():
            say(f"  {name}: {value:.6g}" if isinstance(value, float) else f"  {name}: {value}")
        for name, digest in header.inputs.items():
            say(f"  made from {name}: SHA-256 {digest}")
        say("settings:")
        say("".join(f"  {line}\n" for line in header.settings.splitlines()).rstrip("\n"))
        say("datasets:")
        for name, dataset in datasets(artefact).items():
            shape = " × ".join(str(size) for size in dataset.shape) or "scalar"
            say(f"  {name}  {shape}  {dataset.dtype}")


def say(line: str) -> None:
    """One line of what the file says, without what a terminal would obey."""
    click.echo(printable(line))
