"""`make paper`: make the paper's tables and figures again and say which of their relations hold."""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from typing import Any

import click

from ldsim.artefacts.atomic import replacing
from ldsim.errors import LdsimError, SettingsError
from reproduction.harness import CONFIGS, PICTURES, PIPELINE, RESULTS, ROOT, Harness, note, origin, write_json
from reproduction.paper.experiment import Outcome
from reproduction.paper.table import EXPERIMENTS

# What only draws, words or keeps what was found.
FRAME = {"reproduction.harness", "reproduction.pages", "reproduction.paper.experiment", "reproduction.paper.stills"}


def inputs(name: str) -> list[str]:
    """What an experiment's result follows from: the rooms that compute, its modules and their settings."""
    modules = (module.replace(".", "/") + ".py" for module in used_modules(EXPERIMENTS[name].run.__module__))
    settings = (path.relative_to(ROOT).as_posix() for path in (CONFIGS / "paper").glob("*.yaml"))
    return [*PIPELINE, *sorted((*modules, *settings))]


def used_modules(module: str) -> set[str]:
    """A module of reproduction/ and those that it imports from."""
    found, open_ones = set[str](), {module}
    while open_ones:
        found |= open_ones
        files = [ROOT / f"{each.replace('.', '/')}.py" for each in open_ones]
        trees = [ast.parse(file.read_text(encoding="utf-8")) for file in files if file.is_file()]
        taken = {node.module or "" for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        open_ones = {each for each in taken if each.startswith("reproduction.")} - found - FRAME
    return found


def record(name: str, quick: bool, outcome: Outcome) -> dict[str, Any]:
    """The JSON of an experiment."""
    relations = [relation.record() for relation in outcome.relations]
    return {
        "experiment": name,
        "shows": EXPERIMENTS[name].shows,
        "size": "quick" if quick else "full",
        "passed": all(relation["holds"] for relation in relations),
        "relations": relations,
        "numbers": outcome.numbers,
        **origin(f"make paper NAME={name}{' QUICK=yes' if quick else ''}", inputs=inputs(name)),
    }


def write_outcome(folder: Path, pictures: Path, name: str, quick: bool, outcome: Outcome) -> dict[str, Any]:
    """Write paper_NAME.svg and, where there are solids to show, paper_NAME.webp; NAME.json, and return its content."""
    content = record(name, quick, outcome)
    with replacing(pictures / f"paper_{name}.svg") as temporary:
        temporary.write_text(outcome.figure, encoding="utf-8")
    if outcome.still is not None:
        with replacing(pictures / f"paper_{name}.webp") as temporary:
            temporary.write_bytes(outcome.still)
    write_json(folder / f"{name}.json", content)
    if not quick:
        result = (folder / f"{name}.json").resolve()
        shown = result.relative_to(ROOT) if result.is_relative_to(ROOT) else result
        for picture in pictures.glob(f"paper_{name}.*"):
            note(picture.name, [str(shown)])
    return content


def _make(name: str, runs: Path, quick: bool) -> bool:
    """Make one experiment, say what it found, and return whether every relation holds."""
    bench = Harness(runs, name, quick)
    # what was made in full size is committed, and docs/paper.md shows it
    folder, pictures = (bench.folder, bench.folder) if quick else (RESULTS / "paper", PICTURES)
    content = write_outcome(folder, pictures, name, quick, EXPERIMENTS[name].run(bench))
    click.echo(f"{name}: {content['shows']}: {'passed' if content['passed'] else 'FAILED'}")
    for relation in content["relations"]:
        value = "not finite" if relation["value"] is None else f"{relation['value']:.4g}"
        mark = "holds" if relation["holds"] else "FAILS"
        click.echo(f"  {mark}: {relation['claim']}: {value}, expected {relation['goal']}")
    click.echo(f"  {folder}/{name}.json, {pictures}/paper_{name}.svg")
    return bool(content["passed"])


@click.command(help="Make a table or figure of the paper again; `all` makes every one, `list` lists them.")
@click.argument("name")
@click.option("--quick", is_flag=True, help="A small version of about a minute or two.")
@click.option("--runs", type=click.Path(path_type=Path), default=Path("runs"), help="Folder of all runs.")
def command(name: str, quick: bool, runs: Path) -> None:
    try:
        _answer(name, quick, runs)
    except LdsimError as error:
        click.echo(f"error: {' '.join(str(error).split())}", err=True)
        sys.exit(1)


def _answer(name: str, quick: bool, runs: Path) -> None:
    if name == "list":
        for key, experiment in EXPERIMENTS.items():
            click.echo(f"{key:10}{experiment.shows}")
    elif name == "all":
        _make_all(runs, quick)
    elif name in EXPERIMENTS:
        _make(name, runs, quick)
    else:
        raise SettingsError(f"there is no experiment {name!r}; known are all, list, {', '.join(EXPERIMENTS)}")


def _make_all(runs: Path, quick: bool) -> None:
    """Every experiment; one that cannot be made is named and does not stop the others.

    Raises:
        SettingsError: some could not be made.
    """
    verdicts: dict[str, str] = {}
    for name in EXPERIMENTS:
        try:
            verdicts[name] = "passed" if _make(name, runs, quick) else "failed"
        except LdsimError as error:
            click.echo(f"{name}: not made: {error}", err=True)
            verdicts[name] = "not made"
    for verdict in ("passed", "failed", "not made"):
        click.echo(f"{verdict}: {', '.join(key for key, value in verdicts.items() if value == verdict) or 'none'}")
    missing = [key for key, value in verdicts.items() if value == "not made"]
    if missing:
        raise SettingsError(f"{', '.join(missing)} could not be made; the reasons are above")


if __name__ == "__main__":
    command()
