"""What experiments and benchmarks share: runs made by the pipeline's stages, results with where and when, a usage."""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ldsim.artefacts.atomic import replacing
from ldsim.cli.stage import Bars
from ldsim.errors import ArtefactError
from ldsim.jit import one_thread
from ldsim.pipeline.cubature import cubature
from ldsim.pipeline.files import file_sums
from ldsim.pipeline.mesh import mesh
from ldsim.pipeline.pca import pca
from ldsim.pipeline.progress import Progress
from ldsim.pipeline.simulate import simulate
from ldsim.pipeline.snapshot import snapshot
from ldsim.pipeline.train import train
from ldsim.report.machine import describe_machine
from ldsim.run import Run
from ldsim.settings import STAGES, Settings, settings_of
from ldsim.settings.make import Staleness
from reproduction.pages import input_hashes, origin_of

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "reproduction" / "results"
PICTURES = ROOT / "docs" / "pictures"
MADE = PICTURES / "made.json"
CONFIGS = ROOT / "configs"

# Rooms whose code decides what a result is.
COMPUTES = [f"ldsim/{room}" for room in ("mesh", "mechanics", "space", "cubature", "learn", "dynamics", "optimise")]
# And what stages do with it.
PIPELINE = [*COMPUTES, "ldsim/pipeline"]

Row = dict[str, Any]
Stage = Callable[[Run, Settings, Progress, Path], object]

FUNCTIONS: dict[str, Stage] = {
    "mesh": lambda run, settings, progress, base: mesh(run, settings.mesh, progress, base),
    "snapshot": lambda run, settings, progress, base: snapshot(run, settings.snapshot, progress, base),
    "pca": lambda run, settings, progress, base: pca(run, settings.pca, progress),
    "train": lambda run, settings, progress, base: train(run, settings.train, progress),
    "cubature": lambda run, settings, progress, base: cubature(run, settings.cubature, progress),
    "simulate": lambda run, settings, progress, base: simulate(run, settings.simulate, progress),
}


@dataclass(frozen=True)
class Harness:
    """Makes an experiment's runs by the pipeline's own stages, and keeps results that need not be made twice.

    Attributes:
        runs: the folder of all runs; results lie in its folder `paper`.
        name: of the experiment.
        quick: whether the small version is wanted.
    """

    runs: Path
    name: str
    quick: bool = False

    @property
    def folder(self) -> Path:
        """Where results lie."""
        return self.runs / "paper" / (f"{self.name}-quick" if self.quick else self.name)

    def made(self, configuration: Mapping[str, Any], last: str) -> Path:
        """The folder of a run finished up to a stage; stages whose artefact fits the configuration are left alone."""
        settings = settings_of(configuration, f"paper {self.name}")
        folder = self.runs / settings.experiment
        wanted = STAGES[: STAGES.index(last) + 1]
        for stage in wanted:
            # what is missing is said before anything runs
            file_sums(getattr(settings.section(stage), "input_files", ()), folder)
        with replacing(folder / "paper.yaml") as temporary:
            temporary.write_text(settings.dump(), encoding="utf-8")
        return finished(folder, settings, wanted, folder)

    def file(self, name: str, text: str) -> Path:
        """A small input file of this content, in the folder of the results."""
        path = (self.folder / name).resolve()
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            with replacing(path) as temporary:
                temporary.write_text(text, encoding="utf-8")
        return path

    def remembered(self, name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """A result, computed once and kept; `name` must tell all that it depends on besides the runs and the code of
        `COMPUTES`."""
        path = self.folder / "remembered.json"
        known: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        key = f"{name}; {code_of(COMPUTES)}"
        if key not in known:
            known[key] = compute()
            print(f"{self.name}: {name}: {json.dumps(known[key])}", file=sys.stderr)
            write_json(path, known)
        result: dict[str, Any] = known[key]
        return result


def code_of(rooms: Sequence[str]) -> str:
    """A digest of the code of some rooms."""
    return hashlib.sha256(json.dumps(input_hashes(rooms)).encode()).hexdigest()[:12]


def finished(folder: Path, settings: Settings, stages: Sequence[str], base: Path) -> Path:
    """The folder of a run after some stages; those whose artefact fits the settings are left alone.

    Args:
        base: the folder that paths in the settings are relative to.
    """
    with Run(folder, settings.experiment) as run:
        for stage in stages:
            if is_stale(run, settings, stage, base):
                FUNCTIONS[stage](run, settings, Bars(), base)
    return folder


def is_stale(run: Run, settings: Settings, stage: str, base: Path) -> bool:
    """Whether a stage has to run; also where what it wrote is damaged, or of another version of ldsim."""
    try:
        return bool(Staleness(run, settings, base).reasons(stage))
    except ArtefactError:
        return True


def ldsim(folder: Path, *words: str) -> int:
    """The exit status of a command of ldsim, called in a folder; what it says goes to the terminal."""
    print(f"$ ldsim {' '.join(words)}", flush=True)
    return subprocess.run([sys.executable, "-m", "ldsim", *words], cwd=folder, check=False).returncode


def linked(source: Path, folder: Path, kinds: Sequence[str]) -> Path:
    """A folder that has some artefacts of a run, where it has none of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind in kinds:
        target = folder / f"{kind}.h5"
        if not target.exists():
            target.symlink_to((source / target.name).resolve())
    return folder


def row(model: str, quantity: str, value: object, unit: str = "", goal: str | None = None) -> Row:
    """One measured number, null where a run was lost; the goal is a comparison such as ">= 10"."""
    lost = isinstance(value, float) and not math.isfinite(value)
    return {"model": model, "quantity": quantity, "value": None if lost else value, "unit": unit, "goal": goal}


def show(rows: Sequence[Row], title: str | None = None) -> None:
    """Print rows, a line of a table each, under a title where one is given."""
    if title is not None:
        print(f"\n## {title}\n\n| model | quantity | value | unit | goal |\n|---|---|---|---|---|")
    for r in rows:
        value = "–" if r["value"] is None else f"{r['value']:.4g}" if isinstance(r["value"], float) else r["value"]
        print(f"| {r['model']} | {r['quantity']} | {value} | {r['unit']} | {r['goal'] or ''} |", flush=True)


def parser(name: str, description: str | None, room: str = "bench") -> argparse.ArgumentParser:
    """Of the arguments of `python -m reproduction.ROOM.NAME`."""
    return argparse.ArgumentParser(
        prog=f"python -m reproduction.{room}.{name}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def over_runs(name: str, description: str | None, measure: Callable[[Run], list[Row]], inputs: Sequence[str]) -> None:
    """The command of a benchmark that measures the finished runs that it is given, and writes results/NAME.json."""
    arguments = parser(name, description)
    arguments.add_argument("runs", nargs="+", type=Path, help="folders of finished runs")
    rows = list[Row]()
    with one_thread():
        for folder in arguments.parse_args().runs:
            with Run.open(folder) as run:
                rows += measure(run)
    show(rows)
    write_results(name, called(name), rows, inputs=inputs)


def called(name: str, room: str = "bench") -> str:
    """The command that a benchmark was called by; a path to no file of the project becomes one in runs/, for it says
    nothing elsewhere."""
    paths = {word: Path(word).resolve() for word in sys.argv[1:] if "/" in word}
    ours = {word for word, path in paths.items() if path.is_file() and path.is_relative_to(ROOT)}
    said = {word: str(path.relative_to(ROOT)) if word in ours else f"runs/{path.name}" for word, path in paths.items()}
    words = [said.get(word, word) for word in sys.argv[1:]]
    return " ".join(["python -m", f"reproduction.{room}.{name}", *words])


def origin(
    command: str,
    machine: Mapping[str, Any] | None = None,
    created: str | None = None,
    inputs: Sequence[str] = (),
) -> dict[str, Any]:
    """Where results come from: machine and versions, command, commit and time.

    Args:
        machine: where it was measured, as `describe_machine` says it; by default here.
        created: when, in ISO format; by default now.
        inputs: files and folders of the project that they depend on; where one changes, pages say that they are stale.
    """
    described = describe_machine() if machine is None else machine
    return {
        "machine": {key: value for key, value in described.items() if key != "versions"},
        "versions": described["versions"],
        "command": command,
        "commit": checked_out(),
        "created": created or datetime.now(UTC).isoformat(timespec="seconds"),
        "inputs": input_hashes(inputs),
    }


def write_results(
    name: str,
    command: str,
    rows: Sequence[Row],
    machine: Mapping[str, Any] | None = None,
    created: str | None = None,
    inputs: Sequence[str] = (),
) -> Path:
    """Write results/NAME.json, which is committed, so that history shows; returns the file. See `origin`."""
    path = RESULTS / f"{name}.json"
    write_json(path, origin(command, machine, created, inputs) | {"rows": rows})
    return path


def rows_before(name: str, model: str) -> list[Row]:
    """What the results of a name hold of a model; none where there are no results."""
    return [each for each in _results(name)["rows"] if each["model"] == model]


def add_results(name: str, command: str, rows: Sequence[Row], inputs: Sequence[str]) -> Path:
    """Write the rows of some models into results/NAME.json, beside those of all others; returns the file.

    Where others' rows come from stays with them, in `earlier` by model, where it was another code, configuration or
    command.
    """
    content, now = _results(name), origin(command, inputs=inputs)
    found = {model: rows_before(name, model) for model in dict.fromkeys(each["model"] for each in content["rows"])}
    own = {
        model: [each for each in rows if each["model"] == model] for model in dict.fromkeys(r["model"] for r in rows)
    }
    before = {model: origin_of(content, model) for model in found if model not in own}
    other = {model: {key: each.get(key) for key in now} for model, each in before.items()}
    earlier = {
        model: each for model, each in other.items() if any(each[key] != now[key] for key in ("inputs", "command"))
    }
    path = RESULTS / f"{name}.json"
    write_json(path, now | ({"earlier": earlier} if earlier else {}) | {"rows": sum((found | own).values(), [])})
    return path


def _results(name: str) -> dict[str, Any]:
    try:
        content: dict[str, Any] = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {"rows": []}
    return content


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON with null for every number that JSON does not know, and a line for whatever holds nothing nested."""
    text = _lines(_finite(content)) + "\n"
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def note(name: str, shows: Sequence[str]) -> None:
    """Remember what a picture shows, files of the project as they are now."""
    made = json.loads(MADE.read_text(encoding="utf-8")) if MADE.is_file() else {}
    write_json(MADE, dict(sorted({**made, name: input_hashes(shows)}.items())))


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _lines(value: Any, margin: str = "\n") -> str:
    nested = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    if not any(isinstance(each, dict | list) for each in nested):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    inner = margin + " "
    if isinstance(value, dict):
        entries = [f"{json.dumps(key, ensure_ascii=False)}: {_lines(each, inner)}" for key, each in value.items()]
        return "{" + inner + ("," + inner).join(entries) + margin + "}"
    return "[" + inner + ("," + inner).join(_lines(each, inner) for each in value) + margin + "]"


def checked_out() -> str | None:
    """What is checked out, "-dirty" where a file differs from it that is no result; null outside of a repository."""
    commands = ("describe --always --abbrev=12", "status --porcelain --untracked-files=no -- . :!reproduction/results")
    try:
        commit, changed = (
            subprocess.run(["git", *each.split()], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
            for each in commands
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return f"{commit}-dirty" if changed else commit
