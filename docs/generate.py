"""Makes the pages of docs/reference/ that follow from the code: settings, schema, artefacts, commands and report.json.

`python docs/generate.py` writes them; a test compares the committed pages with what this file makes of the code.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Iterator, Mapping
from enum import Enum
from functools import cached_property
from pathlib import Path
from types import FunctionType
from typing import Any

import click

from ldsim import BatchedSimulator, Run, Simulator, load, simulate, view
from ldsim.artefacts.schema import SCHEMA_VERSION, SCHEMAS, Dataset
from ldsim.artefacts.store import HEADER, WRITTEN_BY
from ldsim.cli.app import COMMANDS, main
from ldsim.export.playground import assembled
from ldsim.optimise.solution import Reason
from ldsim.pipeline.files import DATA_VARIABLE
from ldsim.report.schema import RunNumbers
from ldsim.report.wording import counted
from ldsim.settings import STAGES, Settings, load_settings
from ldsim.simulator import Handle, Outcome, StepRecord

sys.path.insert(0, str(Path(__file__).parent.parent))
from reproduction.pages import PAGES, filled  # noqa: E402 reproduction is not installed
from reproduction.paper.page import paper_page  # noqa: E402

HERE = Path(__file__).parent / "reference"
LIVE = HERE.parent / "live" / "demo.html"
CONFIGS = Path(__file__).parent.parent / "configs"
EXAMPLES = CONFIGS.parent / "reproduction" / "results" / "examples.json"
MADE = "<!-- Made by docs/generate.py from {source}; do not edit. -->\n"
Node = Mapping[str, Any]

SETTINGS_INTRODUCTION = f"""# Settings

A configuration is one YAML file: the name of the experiment and one section for each stage. This page lists every key.
`ldsim settings FILE` checks a configuration and prints it with its defaults. An unknown key is refused, and the message
names the nearest known one.

A relative path is relative to the folder of the configuration. `${DATA_VARIABLE}` in a path stands for the environment
variable of that name. A key in brackets, `pins[]`, is an entry of a list. "Required" means: required where its section
is given. Lengths are in metres, times in seconds, unless the name of the key says otherwise. Write numbers with an
exponent as `6.0e+4`; YAML reads `6e4` as text, which is then turned into a number.

Editors that know the YAML language server complete and check keys against [schema.json](schema.json) when the first
line of a configuration in `configs/` is

    # yaml-language-server: $schema=../docs/reference/schema.json

The schema does not know rules about two keys at once, such as "exactly one of file, shape"; `ldsim settings` does.
"""

ARTEFACTS_INTRODUCTION = f"""# Artefacts

Every stage writes one HDF5 file into `runs/<experiment>/`. A file is written under a temporary name and renamed when it
is whole. `ldsim info FILE` prints its header and its datasets. This page describes schema version {SCHEMA_VERSION}.

A type is a numpy type code: `f8` float64, `f4` float32, `i8` int64, `i4` int32, `i1` int8, `?` bool. A shape is a tuple
of numbers and symbols; `()` is a scalar. The same symbol has the same value throughout a file, except in a path with
`*`. There `*` stands for a name (of a motion, a space or a layer), and the symbols belong to that group alone; n is the
same everywhere. A dataset that is neither marked optional nor has a `*` in its path is always there.

The first 512 bytes, HDF5's user block, hold the size and the SHA-256 of the rest. Reading a file checks this sum before
anything else, then its kind, its schema version, and the type, the shape and the values of every dataset; data that lie
in another file, links, and filters are refused. Whoever changes an artefact on purpose writes its sum anew with
`ldsim.artefacts.sealed_file.seal`.

Degrees of freedom are vertex-major: x₀, y₀, z₀, x₁, … All units are SI. A `reason` is one of
{", ".join(f"{reason.value} ({reason.words})" for reason in Reason)}.

## Header

Every file has these attributes on `/`.

| attribute | meaning |
|---|---|
"""

REPORT_INTRODUCTION = """# report.json

`ldsim report` writes every number of a run to `runs/<experiment>/report/report.json`. Lengths are in millimetres, times
in seconds unless the key says otherwise. A value that was not measured is null; no key is ever missing.
`simulate.full[]` is an entry of a list, `<name>` stands for any name.
[The tutorial](../guide/tutorial.md#reading-the-report) says how to read it.

| key | type | meaning |
|---|---|---|
"""

PYTHON_INTRODUCTION = """# Python

`from ldsim import load, view, BatchedSimulator, Run, simulate, Simulator` is the front door;
[the simulator](../guide/simulator.md) shows it in use, [batches](../guide/batched.md) step many instances at once, and
the stages are [functions](../guide/python.md).
"""

GALLERY_INTRODUCTION = """# Gallery

Every configuration that ships with the project: at rest, and where its first motion moves it most. On the site, which
`make site` builds, each has a live page that simulates in the browser. `make EXPERIMENT=NAME` runs all stages of one,
and `ldsim play runs/NAME` lets you pull at it then. `make examples` runs all of them, and `make pictures` makes the
pictures anew.

"""
# What a live page cannot do; docs/site.py puts it beside the link.
SWINGS = "Its live page swings, as `ldsim play` does: they step in time, while it has learned from equilibria alone."
PINNED = "Its live page can be pulled at, but cannot move the pins: the motions that do are played in its report."

HEADER_MEANINGS = {
    "kind": "one of " + ", ".join(f"`{kind}`" for kind in SCHEMAS),
    "schema_version": "version of this page's tables",
    "ldsim_version": "version of the program that wrote the file",
    "created": "date and time, UTC",
    "settings": "the section of the stage that wrote the file, as YAML with defaults",
    "inputs": "JSON object: name of each artefact read → SHA-256 of its file",
    "seed": "of everything random in the stage, −1 where nothing is",
    "experiment, stage": "names",
    "seconds, peak_memory_mb": "wall time of the stage; largest resident memory of one of its processes, 10⁶ bytes",
}

SYMBOLS = (
    "n vertices · m cells · a nodes of a cell (in cubature.h5: points of all rules together) · s quadrature points · "
    "N frames (in `singular_values`: training snapshots) · k PCA dimension · r latent dimension · c cubature points · "
    "D drags · T frames of all drags together · H held vertices of all drags together · S moving "
    "supports · V their vertices together · v vertices of a group (there c its cells) · d = 3n · e = k + 1 · l rules "
    "of the path · i, o inputs and outputs of a layer."
)

NOTES = {
    "snapshots": "The motions of the roles `train` and `validation`. Each group `motions/<name>` has the attributes "
    "`role`, `order` (its place in the configuration), `frames` (N) and `identity` (a hash of all that the run depends "
    "on). Drags and held vertices lie one after another; `drag_frames` and `held_count` say where one ends.",
    "tests": "The motions of the role `test`, as in snapshots.h5; there may be none. Nothing before `ldsim simulate` "
    "reads it.",
    "model": "The header also has `activation`, and `met`: 1 where the largest training error is within "
    "`train.tolerance_mm`, else 0; a condensed space has no `met`. Layers are numbered from 0. The decoder is "
    "φ(z) = N(z) − N(0), of a condensed space + Aᵀz, the encoder ψ(q) = E(q) − E(0), with N and E the perceptrons "
    "stored here ([theory](../guide/theory.md)).",
    "cubature": "The groups are `latent`, `linear` (of kp columns) and `linear_<k>` of other sizes. The rules of a "
    "path are of growing size and falling error; `chosen` is the one that the fit was for. The header also has the "
    "seconds that each fit took.",
    "simulation": "The path is `runs/<space>/<motion>/…` with the spaces of cubature.h5 and `full`. The full space "
    "is timed on a stretch of the motion only, so its N is smaller. A reduced run that is lost holds NaN from there "
    "on. The header also names the minimiser and the points of each space, and in `space` the one to use.",
}


def pages() -> dict[Path, str]:
    """Every generated page, and every page with generated numbers, with its text."""
    measured = {page: filled(page.read_text(encoding="utf-8")) for page in PAGES}
    return measured | {
        HERE / "settings.md": settings_page(),
        HERE / "schema.json": json.dumps(Settings.model_json_schema(), indent=2, ensure_ascii=False) + "\n",
        HERE / "artefacts.md": artefacts_page(),
        HERE / "commands.md": commands_page(),
        HERE / "report.md": report_page(),
        HERE / "python.md": python_page(),
        HERE.parent / "gallery.md": gallery_page(),
        HERE.parent / "paper.md": MADE.format(source="reproduction/results/paper/") + paper_page(),
        LIVE: live_page(),
    }


def live_page() -> str:
    """live/demo.html: the models that it holds, in the page as it is today; `make pictures` makes it from the run."""
    text = LIVE.read_text(encoding="utf-8")
    about, packed = (
        json.loads(re.findall(rf'<script type="application/json" id="{name}">(.*?)</script>', text)[0])
        for name in ("about", "model")
    )
    return assembled(about, packed)


def commands_page() -> str:
    """The help of every command."""
    text = MADE.format(source="the help of the commands") + "\n# Commands\n"
    for name in COMMANDS:
        group: click.Group = main
        command = group.get_command(click.Context(main), name)
        assert command is not None
        context = click.Context(
            command,
            info_name=f"ldsim {name}",
            max_content_width=100,
            terminal_width=100,
            help_option_names=["-h", "--help"],
        )
        text += f"\n## ldsim {name}\n\n```text\n{command.get_help(context).rstrip()}\n```\n"
    return text


def gallery_page() -> str:
    """Every configuration by its first comment, with its picture and what came of it when it last ran."""
    text = MADE.format(source="configs/*.yaml and what `make examples` found") + GALLERY_INTRODUCTION
    rows = json.loads(EXAMPLES.read_text(encoding="utf-8"))["rows"]
    for config in sorted(CONFIGS.glob("*.yaml")):
        about = config.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
        picture = f"pictures/example_{config.stem}.webp"
        text += f"\n## {config.stem}\n\n{about}\n\n"
        if (HERE.parent / picture).is_file():
            text += f"![{config.stem} at rest and moved]({picture})\n\n"
        text += " ".join([_came_of(config.stem, rows), *_of_live_page(config)]) + "\n"
    return text


def _came_of(example: str, rows: list[dict[str, Any]]) -> str:
    """What its last run came to, in a sentence or two."""
    found = {row["quantity"]: row["value"] for row in rows if row["model"] == example}
    paper = "Its mesh and recordings are those of the paper, which are not part of this project. "
    told = paper if DATA_VARIABLE in (CONFIGS / f"{example}.yaml").read_text(encoding="utf-8") else ""
    if "chosen space" not in found:
        return f"{told}It has not run to its end here."
    space = found["chosen space"].partition("_")[0]
    motion, error = next((key, value) for key, value in found.items() if key.startswith("its error, "))
    name = motion.removeprefix("its error, ")
    told += f"{found['cells']:,} cells, moved by {counted(found['its numbers'], 'number')} in the {space} space"
    told += "" if error is None else f", {100 * error:.2g} % off in {name}"
    return f"{told}. Its report says: {found['verdict']}."


def _of_live_page(config: Path) -> list[str]:
    """What its live page lacks, in words."""
    snapshot = load_settings(config).snapshot
    moved = any(motion.script is not None and motion.script.moving_pins for motion in snapshot.motions)
    return [SWINGS] * snapshot.quasistatic + [PINNED] * moved


def settings_page() -> str:
    """One table a stage."""
    schema = Settings.model_json_schema()
    properties = schema["properties"]
    text = MADE.format(source="ldsim/settings/") + SETTINGS_INTRODUCTION
    text += "\n## experiment\n\n" + _settings_table(_rows("experiment", properties["experiment"], schema, True))
    for stage in STAGES:
        section = _resolved(properties[stage], schema)
        about = str(section.get("description", ""))
        text += f"\n## {stage}\n\n" + (f"{about}\n\n" if about else "")
        text += _settings_table(row for key in section["properties"] for row in _key_rows(stage, key, section, schema))
    return text


def _settings_table(rows: Iterator[tuple[str, ...]]) -> str:
    lines = ["| key | type | default | allowed | meaning |", "|---|---|---|---|---|"]
    return "\n".join(lines + [f"| {' | '.join(row)} |" for row in rows]) + "\n"


def _key_rows(path: str, key: str, section: Node, schema: Node) -> Iterator[tuple[str, ...]]:
    return _rows(f"{path}.{key}", section["properties"][key], schema, key in section.get("required", ()))


def _rows(path: str, node: Node, schema: Node, required: bool) -> Iterator[tuple[str, ...]]:
    """The row of one key, and those of the keys below it."""
    inner = _without_null(node)
    default = "required" if required else _default(node)
    meaning = str(node.get("description", "")).replace("<", "&lt;")
    yield f"`{path}`", _type(inner), default, _allowed(inner), meaning
    below, brackets = (inner["items"], "[]") if "items" in inner else (inner, "")
    section = _resolved(below, schema)
    for key in section.get("properties", ()):
        yield from _key_rows(path + brackets, key, section, schema)


def _resolved(node: Node, schema: Node) -> Node:
    reference = node.get("$ref")
    found: Node = schema["$defs"][reference.rsplit("/", 1)[-1]] if reference else node
    return found


def _without_null(node: Node) -> Node:
    """What a value is where it is given."""
    options = [option for option in node.get("anyOf", ()) if option.get("type") != "null"]
    return options[0] if options else node


def _type(node: Node) -> str:
    if "$ref" in node:
        return "section"
    if "prefixItems" in node:
        return f"{len(node['prefixItems'])} numbers"
    if "items" in node:
        items = _type(node["items"])
        return f"list of {items}s" if not items.endswith("text") else "list of texts"
    names = {"string": "text", "number": "number", "integer": "whole number", "boolean": "true or false"}
    return names[node["type"]]


def _default(node: Node) -> str:
    value = node.get("default")
    return "left out" if value is None else f"`{json.dumps(value)}`".replace('"', "")


def _allowed(node: Node) -> str:
    if "enum" in node:
        return ", ".join(f"`{value}`" for value in node["enum"])
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    limits = [f"{sign} {node[name]:g}" for name, sign in signs.items() if name in node]
    if "prefixItems" not in node and "minItems" in node:
        limits.append(f"at least {node['minItems']}")
    if "pattern" in node:
        device = "cuda" in node["pattern"]
        limits.append("`auto`, `cpu`, `cuda`, `cuda:1`" if device else "letters, digits, `_`, `.`, `-`")
    if "items" in node and "$ref" not in node["items"]:
        limits.append(_allowed(node["items"]))
    return ", ".join(limit for limit in limits if limit)


def artefacts_page() -> str:
    """The header and one table a kind."""
    missing = [name for name in HEADER if name not in HEADER_MEANINGS]
    assert not missing, f"describe the header's attributes {missing}"
    text = MADE.format(source="ldsim/artefacts/schema.py") + ARTEFACTS_INTRODUCTION
    text += "".join(f"| {name} | {meaning} |\n" for name, meaning in HEADER_MEANINGS.items())
    text += f"\n## Symbols\n\n{SYMBOLS}\n"
    for kind, stage in WRITTEN_BY.items():
        text += f"\n## {kind}.h5\n\nKind `{kind}`, written by `ldsim {stage}`."
        text += f" {NOTES[kind]}\n\n" if kind in NOTES else "\n\n"
        if kind == "tests":
            continue
        text += "| dataset | type | shape | values | unit | meaning |\n|---|---|---|---|---|---|\n"
        text += "".join(_dataset_row(entry) for entry in SCHEMAS[kind])
    return text


def _dataset_row(entry: Dataset) -> str:
    shape = ", ".join(str(size) for size in entry.shape) + ("," if len(entry.shape) == 1 else "")
    meaning = entry.meaning + (" (optional)" if entry.optional else "")
    return f"| `{entry.path}` | `{entry.dtype}` | ({shape}) | {entry.allowed.words} | {entry.unit} | {meaning} |\n"


def report_page() -> str:
    """reference/report.md: every key of report.json."""
    schema = RunNumbers.model_json_schema()
    rows = (row for key in schema["properties"] for row in _report_rows(key, schema["properties"][key], schema))
    return MADE.format(source="ldsim/report/schema.py") + REPORT_INTRODUCTION + "".join(rows)


def _report_rows(path: str, node: Node, schema: Node) -> Iterator[str]:
    """The row of one key, and those of the keys below it."""
    inner = _without_null(node)
    below, suffix = (inner["items"], "[]") if "items" in inner else (inner.get("additionalProperties") or inner, "")
    suffix = ".<name>" if below is inner.get("additionalProperties") else suffix
    section = _resolved(below, schema)
    kind = "object" if "properties" in section else _type(section)
    kind = {"[]": f"list of {kind}s", ".<name>": f"{kind} for each name"}.get(suffix, kind)
    allowed = f": {', '.join(section['enum'])}" if "enum" in section else ""
    null = " or null" if inner is not node else ""
    about = node.get("description") or section.get("description", "")
    yield f"| `{path}{suffix}` | {kind}{null}{allowed} | {about} |\n"
    for key, child in section.get("properties", {}).items():
        yield from _report_rows(f"{path}{suffix}.{key}", child, schema)


def python_page() -> str:
    """reference/python.md: the front door, by signatures and docstrings."""
    text = MADE.format(source="the docstrings of the code") + PYTHON_INTRODUCTION
    for thing in (load, view, Simulator, Handle, StepRecord, Outcome, BatchedSimulator, Run, simulate):
        text += f"\n## {thing.__name__}\n\n" + _described(thing, thing.__name__)
        if not inspect.isclass(thing) or issubclass(thing, Enum):
            continue
        for name, member in vars(thing).items():
            if not name.startswith("_") and isinstance(member, FunctionType | property | cached_property | classmethod):
                text += f"\n### {thing.__name__}.{name}\n\n" + _described(member, name)
    return text


def _described(thing: Any, name: str) -> str:
    """The signature, where there is one to call, and the docstring."""
    function = thing.__func__ if isinstance(thing, classmethod) else thing
    callable_ = inspect.isfunction(function) or (inspect.isclass(function) and not issubclass(function, Enum))
    signature = f"{name}{inspect.signature(function)}\n\n" if callable_ else ""
    plain = re.sub(r"(: |-> )'([^']*)'", r"\1\2", signature)
    return f"```text\n{plain}{inspect.getdoc(thing) or ''}\n```\n"


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
        print(path)
