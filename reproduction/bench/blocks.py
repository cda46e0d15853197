"""Every line for a shell on README and the guide's pages, run for real where the tests only read it.

    python -m reproduction.bench.blocks --folder /tmp/blocks                    all pages, in turn: an hour
    python -m reproduction.bench.blocks --folder /tmp/blocks tutorial runtime   some; of others what is known is kept

Each page has a clone of the project, with the files that it presumes, and its lines run there in their order.
The solids of a reader are small ones here, so that what takes him half an hour takes minutes. Examples that have run
before (`make examples`) are copied from runs/ and found up to date; the demo has to be there. pip says what it would
install and installs nothing. A page that is served is opened in Chromium, where the solid is pulled, and then ended by
Ctrl-C. reproduction/results/blocks.json has the exit status of every line; a test fails where a line of a page is not
among them. blocks_lines.py has the lines that the tests run, and those that nothing can run here.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import meshio
import yaml

from reproduction.bench.blocks_lines import FENCED, PRESUMED, STANDS_FOR, is_quick, is_server, lines_of, reason
from reproduction.bench.newcomer import pulled
from reproduction.bench.solid_files import write_solid
from reproduction.harness import CONFIGS, RESULTS, ROOT, Row, origin, parser, row, show, write_json
from reproduction.pages import PAGES
from tests.viewer.browser import Tab

NAME = "blocks"
RESULT = RESULTS / f"{NAME}.json"
# The number of tets of a solid of the reader's, as `ldsim new` writes it, and here.
ASKED, SMALL = "cells: 10000", "cells: 800"
# Of a pull in the browser: how far a solid moves at least, whatever it is made of, and how long a take is.
LEAST_M, RECORDED_FRAMES = 1e-4, 300
# The longest that a line may take, and until a server answers.
LONGEST_S, SERVER_S = 3600.0, 10.0


@dataclass
class Place:
    """Where the lines of a page are typed.

    Attributes:
        folder: the clone.
        within: the folder that `cd` has led to.
    """

    folder: Path
    within: Path

    @property
    def environment(self) -> dict[str, str]:
        """That of a reader who has activated .venv; the clone's code comes before that which is installed."""
        path = f"{self.folder / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
        own = {"PATH": path, "PYTHONPATH": str(self.folder), "BROWSER": "true"}
        return {name: value for name, value in os.environ.items() if name not in ("LDSIM_DATA", "MAKEFLAGS")} | own

    def start(self, line: str, out: IO[str] | int) -> subprocess.Popen[str]:
        """A line at work; it leaves where it led to in a file."""
        for words, here in STANDS_FOR.items():
            line = line.replace(words, here.format(folder=self.folder))
        script = f"{line}\nstatus=$?\npwd > '{self._left}'\nexit $status"
        return subprocess.Popen(
            ["bash", "-c", script],
            cwd=self.within,
            env=self.environment,
            stdout=out,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,  # so that Ctrl-C reaches all of it and nothing else
        )

    def status(self, line: str, log: IO[str]) -> int:
        """The exit status of a line, run to its end; what it serves is opened and then ended."""
        with self.start(line, subprocess.PIPE) as process:
            assert process.stdout is not None
            late = threading.Timer(LONGEST_S, os.killpg, (process.pid, signal.SIGTERM))
            late.daemon = True  # it holds up nobody who has failed
            late.start()
            for text in process.stdout:
                print(text, end="", file=log, flush=True)
                if text.startswith("http"):
                    try:
                        _pull(text.strip(), "ldsim record" in line)
                    finally:
                        os.killpg(process.pid, signal.SIGINT)
            late.cancel()
        if self._left.is_file():  # not where it was killed
            self.within = Path(self._left.read_text(encoding="utf-8").strip())
            self._left.unlink()
        return process.returncode

    @property
    def _left(self) -> Path:
        return self.folder / "within"


def page_place(page: Path, folder: Path, runs: Path) -> Place:
    """A clone with the files that the page presumes."""
    place = folder / page.stem
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(place)], check=True)
    (place / ".venv").symlink_to(Path(sys.prefix).resolve())
    for name in ("pyproject.toml", "requirements.lock"):
        os.utime(place / name, (0, 0))  # the environment is newer, and make leaves it alone
    for name in _named(page):
        if (runs / name / "report").is_dir():
            shutil.copytree(runs / name, place / "runs" / name)
    _solids(place)
    small = (CONFIGS / "ci.yaml").read_text(encoding="utf-8")
    for name in ("beam", "part"):
        (place / "configs" / f"{name}.yaml").write_text(small.replace("experiment: ci", f"experiment: {name}"))
    own = [text for kind, text in FENCED.findall(page.read_text(encoding="utf-8")) if kind == "yaml"]
    for text in own:
        if yaml.safe_load(text).get("experiment") == "part":  # what the reader is told to write
            (place / "configs" / "part.yaml").write_text(text)
    return Place(place, place)


def _named(page: Path) -> set[str]:
    """The examples whose runs the page speaks of; a beam is stood for by a smaller one."""
    words = " ".join(lines_of(page))
    named = {"demo", *re.findall(r"EXPERIMENT=(\w+)", words)} - {"beam", "part"}
    return {name for name in named if (CONFIGS / f"{name}.yaml").is_file()}


def _solids(place: Path) -> None:
    """A surface part.stl and toy.stl, and a mesh part.mesh, in metres, and meshes/part.vtk, in millimetres."""
    surface = write_solid("bracket", place)
    shutil.copy(surface, place / "part.stl")
    surface.rename(place / "toy.stl")
    solid = write_solid("slender", place)
    mesh = meshio.read(solid)
    meshio.write(place / "part.mesh", meshio.Mesh(mesh.points, mesh.cells))
    (place / "meshes").mkdir()
    meshio.write(place / "meshes" / "part.vtk", meshio.Mesh(1e3 * mesh.points, mesh.cells))
    solid.unlink()


def _pull(url: str, record: bool) -> None:
    with pulled(url, least=LEAST_M) as (tab, at):
        if record:
            tab.mouse("mouseReleased", at)
            _record(tab, at)


def _record(tab: Tab, at: tuple[float, float]) -> None:
    """A take, in which the solid is pulled for as long as a model needs."""
    tab.evaluate("document.getElementById('record').click()")
    tab.wait("document.body.classList.contains('recording')")
    first = tab.evaluate("ldsim.frame")
    tab.mouse("mousePressed", at)
    for i in range(40):
        tab.mouse("mouseMoved", (at[0] + 60 * math.sin(i / 3), at[1] - 40 * math.sin(i / 2)))
        tab.wait(f"ldsim.frame >= {first} + {RECORDED_FRAMES * i // 40}")
    tab.mouse("mouseReleased", at)
    tab.wait(f"ldsim.frame >= {first} + {RECORDED_FRAMES}")
    tab.evaluate("document.getElementById('record').click()")
    tab.wait("document.getElementById('motions').textContent.includes('frames')")


@contextmanager
def _servers(place: Place, lines: Sequence[str], log: IO[str]) -> Iterator[dict[str, int]]:
    """What runs beside the other lines, each with its exit status once the block has ended."""
    found: dict[str, int] = {}
    started = []
    for line in filter(is_server, lines):
        print(line, flush=True)
        started.append((line, place.start(line, log)))
        time.sleep(SERVER_S)
    yield found
    for line, process in reversed(started):
        os.killpg(process.pid, signal.SIGINT)
        found[line] = process.wait(timeout=60)


def ran(page: Path, folder: Path, runs: Path) -> list[Row]:
    """The exit status of every line of the page that has to run."""
    lines = [line for line in lines_of(page) if reason(line) is None]
    if all(is_quick(line) for line in lines):
        return []
    place, found = page_place(page, folder, runs), dict[str, int]()
    with (place.folder / "blocks.log").open("w") as log, _servers(place, lines, log) as ended:
        for line in [*PRESUMED.get(page.stem, ()), *lines]:
            if is_server(line) or (is_quick(line) and not line.startswith("ldsim export")):
                continue  # an export may be what the next line is about
            print(f"{page.stem}: {line}", flush=True)
            print(f"$ {line}", file=log, flush=True)
            found[line] = place.status(line, log)
            for made in place.folder.glob("*.yaml"):
                made.write_text(made.read_text(encoding="utf-8").replace(ASKED, SMALL), encoding="utf-8")
    found |= ended
    return [row(page.stem, line, found[line], "", "== 0") for line in lines if line in found and not is_quick(line)]


def keep(found: Mapping[str, Sequence[Row]]) -> None:
    """Write what came of some pages beside what is known of the others, of lines that they still have."""
    known: Any = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.is_file() else {"rows": []}
    rows = []
    for page in PAGES:
        lines = lines_of(page)
        of_page = found.get(page.stem, [each for each in known["rows"] if each["model"] == page.stem])
        rows += [each for each in of_page if each["quantity"] in lines]
    write_json(RESULT, origin(f"python -m reproduction.bench.{NAME} --folder FOLDER") | {"rows": rows})


def main() -> None:
    pages = {page.stem: page for page in PAGES}
    arguments = parser(NAME, __doc__)
    arguments.add_argument("pages", nargs="*", choices=[*pages, []], metavar="PAGE", help="some only")
    arguments.add_argument("--folder", type=Path, required=True, help="an empty one")
    arguments.add_argument("--runs", type=Path, default=Path("runs"), help="where examples have run")
    given = arguments.parse_args()
    found: dict[str, list[Row]] = {}
    for name in given.pages or pages:
        found[name] = ran(pages[name], given.folder.resolve(), given.runs.resolve())
        keep(found)
    rows = [each for name in found for each in found[name]]
    show(rows, "lines for a shell")
    if failed := [each["quantity"] for each in rows if each["value"]]:
        sys.exit("failed: " + "; ".join(failed))


if __name__ == "__main__":
    main()
