"""`make paper`: make the paper's tables and figures again and say which of their relations hold."""

from __future__ import annotations

import contextlib
import importlib
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from ldsim import __version__
from ldsim.artefacts.atomic import replacing
from ldsim.artefacts.store import STAGE_OF, check_inputs, read_header, reading
from ldsim.errors import ArtefactError, LdsimError, SettingsError
from ldsim.report.machine import describe_machine
from ldsim.settings import STAGES, Settings, input_files, settings_of
from reproduction.paper.experiment import Outcome
from reproduction.paper.table import EXPERIMENTS

WRITES = {stage: kind for kind, stage in STAGE_OF.items()}


@dataclass(frozen=True)
class PipelineBench:
    """Makes an experiment's runs by the pipeline's own stages, in the folder of all runs.

    Attributes:
        runs: the folder of all runs; results lie in its folder `paper`.
        name: of the experiment.
        quick: whether the small version is wanted.
    """

    runs: Path
    name: str
    quick: bool

    @property
    def folder(self) -> Path:
        return self.runs / "paper" / (f"{self.name}-quick" if self.quick else self.name)

    def made(self, configuration: Mapping[str, Any], last: str) -> Path:
        """The folder of a run finished up to a stage; stages whose artefact fits the configuration are left alone."""
        settings = settings_of(configuration, f"paper {self.name}")
        folder = self.runs / settings.experiment
        config = folder / "paper.yaml"
        wanted = STAGES[: STAGES.index(last) + 1]
        for stage in wanted:
            input_files(settings, stage, config.parent)
        with replacing(config) as temporary:
            temporary.write_text(settings.dump(), encoding="utf-8")
        for stage in wanted:
            if not _up_to_date(settings, folder, stage):
                command = importlib.import_module(f"ldsim.cli.{stage}").command
                with contextlib.suppress(click.exceptions.Exit):  # cubature has said that it missed its tolerance
                    command.callback(config=config, runs=self.runs)
        return folder

    def file(self, name: str, text: str) -> Path:
        """A small input file of this content, in the folder of the results."""
        path = (self.folder / name).resolve()
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            with replacing(path) as temporary:
                temporary.write_text(text, encoding="utf-8")
        return path

    def remembered(self, name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """A result of an earlier call of the same name and version, or computed and kept."""
        path = self.folder / "remembered.json"
        known: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        key = f"{name}; ldsim {__version__}"
        if key not in known:
            known[key] = compute()
            click.echo(f"{self.name}: {name}: {json.dumps(known[key])}", err=True)
            with replacing(path) as temporary:
                temporary.write_text(json.dumps(known, indent=1), encoding="utf-8")
        result: dict[str, Any] = known[key]
        return result


def _up_to_date(settings: Settings, folder: Path, stage: str) -> bool:
    """Whether a stage's artefact is whole and was made with these settings from the files that lie there."""
    path = folder / f"{WRITES[stage]}.h5"
    try:
        with reading(path, WRITES[stage]) as file:
            header = read_header(file)
        check_inputs(path, header, {kind: folder / f"{kind}.h5" for kind in header.inputs})
    except ArtefactError:
        return False
    return header.settings == settings.section(stage).dump()


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
        "machine": describe_machine(),
        "command": f"make paper NAME={name}{' QUICK=yes' if quick else ''}",
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def write_outcome(folder: Path, name: str, quick: bool, outcome: Outcome) -> dict[str, Any]:
    """Write NAME.svg and NAME.json, and return what the latter holds."""
    content = record(name, quick, outcome)
    text = json.dumps(_finite(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    for suffix, written in (("svg", outcome.figure), ("json", text)):
        with replacing(folder / f"{name}.{suffix}") as temporary:
            temporary.write_text(written, encoding="utf-8")
    return content


def _finite(value: Any) -> Any:
    """The same with null for every number that JSON does not know."""
    if isinstance(value, Mapping):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if isinstance(value, float):
        return value if abs(value) < float("inf") else None
    return value


def _make(name: str, runs: Path, quick: bool) -> bool:
    """Make one experiment, say what it found, and return whether every relation holds."""
    bench = PipelineBench(runs, name, quick)
    content = write_outcome(bench.folder, name, quick, EXPERIMENTS[name].run(bench))
    click.echo(f"{name}: {content['shows']}: {'passed' if content['passed'] else 'FAILED'}")
    for relation in content["relations"]:
        value = "not finite" if relation["value"] is None else f"{relation['value']:.4g}"
        mark = "holds" if relation["holds"] else "FAILS"
        click.echo(f"  {mark}: {relation['claim']}: {value}, expected {relation['goal']}")
    click.echo(f"  {bench.folder}/{name}.svg, {name}.json")
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
            click.echo(f"{key:8}{experiment.shows}")
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
