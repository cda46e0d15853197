"""Every configuration that ships with the project, run to its report and its live page, so that none breaks unnoticed.

    make examples                                       all of configs/, one after the other: an hour and more
    python -m reproduction.bench.examples pins loads    some; what is known of the others is kept

Runs go to runs/, and what is up to date there is not run again. An example that needs what is not here, the paper's
data or an extra of ldsim, is left out, with the reason. The exit status is 1 where a run or its page failed.
reproduction/results/examples.json has the rows of each example and the hashes of its files in the project, as it ran:
docs/gallery.md says what came of it (docs/generate.py), and a test fails where a file has changed since.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ldsim.pipeline.files import DATA_VARIABLE
from ldsim.report.overview import NUMBERS, PAGE, report_of
from ldsim.settings import load_settings
from reproduction.harness import CONFIGS, RESULTS, ROOT, Row, checked_out, ldsim, origin, parser, row, show, write_json
from reproduction.pages import input_hashes

NAME = "examples"
RESULT = RESULTS / f"{NAME}.json"
LEFT_OUT = "left out, because"


def lacking(config: Path) -> str | None:
    """What an example needs that is not here, in words."""
    if DATA_VARIABLE in config.read_text(encoding="utf-8") and not os.environ.get(DATA_VARIABLE):
        return f"{DATA_VARIABLE} is not set: its mesh and recordings are those of the paper"
    if load_settings(config).mesh.surface is not None and importlib.util.find_spec("pytetwild") is None:
        return "the extra is missing: pip install '.[surface]'"
    return None


def files_of(config: Path) -> list[str]:
    """The configuration and what it reads of the project, by their paths there."""
    settings = load_settings(config)
    named = (*settings.mesh.input_files, *settings.snapshot.input_files)
    own = [(config.parent / name).resolve() for name in named if DATA_VARIABLE not in name]
    return [str(path.relative_to(ROOT)) for path in (config.resolve(), *own)]


def ran(config: Path, runs: Path) -> list[Row]:
    """What came of an example that can run here."""
    name, folder = config.stem, runs / config.stem
    print(f"\n{name}", flush=True)
    status = ldsim(Path(), "make", str(config), "--runs", str(runs))
    reported = (folder / NUMBERS).is_file() and (folder / PAGE).is_file()
    rows = [row(name, "exit status", status, "", "== 0"), row(name, "reported", reported, "", "== True")]
    if status or not reported:
        return rows
    page = folder / "export" / f"{name}.html"
    page.unlink(missing_ok=True)
    exported = ldsim(Path(), "export", str(folder), "--playground", "--output", str(page))
    size = page.stat().st_size / 1e6 if page.is_file() else None
    rows += [row(name, "exit status of its page", exported, "", "== 0"), row(name, "live page", size, "MB")]
    return [*rows, *_numbers(name, folder), row(name, "commit", checked_out())]


def _numbers(name: str, folder: Path) -> list[Row]:
    """What the report says of the space that simulate chose, on the motion that its headline is about."""
    numbers = report_of(folder)
    assert numbers is not None, "it has just been reported"
    head = numbers.headline()
    rows = [row(name, "cells", numbers.mesh.cells), row(name, "verdict", numbers.verdict.word)]
    if head is not None:
        rows += [row(name, "chosen space", head.space), row(name, "its numbers", head.dimension)]
        rows += [row(name, f"its error, {head.motion} ({head.role})", head.online_error)]
    return rows


def keep(config: Path, rows: Sequence[Row]) -> None:
    """Write what came of an example beside what is known of the others that still ship.

    One that was left out here keeps what is known of it, as long as its files are the same.
    """
    known: Any = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.is_file() else {"rows": [], "inputs": {}}
    own = input_hashes(files_of(config))
    before = [each for each in known["rows"] if each["model"] == config.stem]
    if before and left_out(rows) and own.items() <= known["inputs"].items():
        return
    shipped = sorted(CONFIGS.glob("*.yaml"))
    found = {each.stem: [line for line in known["rows"] if line["model"] == each.stem] for each in shipped}
    found[config.stem] = list(rows)
    files = {file for each in shipped if found[each.stem] for file in files_of(each)}
    inputs = {file: digest for file, digest in (known["inputs"] | own).items() if file in files}
    content = origin(f"python -m reproduction.bench.{NAME}") | {"inputs": dict(sorted(inputs.items()))}
    write_json(RESULT, content | {"rows": [line for lines in found.values() for line in lines]})


def left_out(rows: Sequence[Row]) -> bool:
    return any(each["quantity"] == LEFT_OUT for each in rows)


def main() -> None:
    configs = {config.stem: config for config in sorted(CONFIGS.glob("*.yaml"))}
    arguments = parser(NAME, __doc__)
    arguments.add_argument("examples", nargs="*", choices=[*configs, []], metavar="EXAMPLE", help="some only")
    arguments.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs")
    given = arguments.parse_args()
    rows: list[Row] = []
    for name in given.examples or configs:
        reason = lacking(configs[name])
        found = ran(configs[name], given.runs) if reason is None else [row(name, LEFT_OUT, reason)]
        keep(configs[name], found)  # after each: who stops it keeps what has run
        rows += found
    show(rows, "examples")
    if failed := sorted({each["model"] for each in rows if missed(each)}):
        sys.exit(f"{', '.join(failed)}: failed")


def missed(found: Row) -> bool:
    """Whether a row is not what it has to be."""
    return found["goal"] is not None and found["goal"] != f"== {found['value']}"


if __name__ == "__main__":
    main()
