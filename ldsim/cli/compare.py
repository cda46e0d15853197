"""`ldsim compare`: one page for several finished runs."""

from __future__ import annotations

import json
import os
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote

import click

from ldsim import __version__
from ldsim.artefacts.atomic import replacing
from ldsim.errors import ExportError
from ldsim.report.compare_figures import figures
from ldsim.report.compare_page import render_comparison
from ldsim.report.compare_runs import Reported, comparison, read_runs


@click.command("compare", help="Put finished RUNs, such as runs/x runs/beam, side by side on one page.")
@click.version_option(__version__, "--version", prog_name="ldsim")
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
    if output.suffix != ".html" or output.is_dir():
        raise ExportError(f"the output is {output}; expected the name of a file that ends in .html")
    read = read_runs(runs)
    created = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    content = comparison(read, created, [_link(run, output) for run in read])
    page = render_comparison(read, content, figures(content["runs"]))
    numbers = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    for path, text in ((output.with_suffix(".json"), numbers), (output, page)):
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    click.echo(f"{output.with_suffix('.json')}: {len(read)} runs, {len(content['warnings'])} warnings")
    click.echo(str(output.resolve()))


def _link(run: Reported, output: Path) -> str:
    """From the page to a run's report, as an address."""
    return quote(Path(os.path.relpath(run.page.resolve(), output.parent.resolve())).as_posix())
