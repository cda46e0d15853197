"""`ldsim compare`: one page for several finished runs."""

from __future__ import annotations

from pathlib import Path

import click

from ldsim.report.compare import compare


@click.command("compare", help="Put finished RUNs, such as runs/x runs/beam, side by side on one page.")
@click.argument("runs", metavar="RUN...", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("compare.html"),
    show_default=True,
    help="The page; its numbers go to a .json beside it.",
)
def command(runs: tuple[Path, ...], output: Path) -> None:
    warnings = compare(runs, output)
    click.echo(f"{output.with_suffix('.json')}: {len(runs)} runs, {len(warnings)} warnings")
    click.echo(str(output.resolve()))
