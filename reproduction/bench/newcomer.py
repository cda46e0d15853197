"""How long a newcomer takes from clone to a solid that follows the pointer: README's two commands, part by part.

    python -m reproduction.bench.newcomer --folder /tmp/new                 all parts, one after the other
    python -m reproduction.bench.newcomer --folder /tmp/new clone install   some; what was measured is kept

A fresh clone, an environment of its own and an empty folder of compiled kernels; the index of packages is the caller's.
The last part, play, ends when the first pull in a browser has moved the solid (needs Chromium). Results go to
reproduction/results/newcomer.json once every part is there: the stages of `make demo` by when each says that it begins,
and beside the time on the clock that of the processors, which other work on the machine hardly lengthens.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ldsim.settings import STAGES
from reproduction.harness import ROOT, parser, row, show, write_json, write_results
from tests.viewer.browser import Tab, chromium

NAME = "newcomer"
PARTS = {
    "clone": ["git", "clone", "--quiet", str(ROOT), "ldsim"],
    "install": ["make", ".venv/.used"],
    "demo": ["make", "demo"],
    "play": [".venv/bin/ldsim", "play", "runs/demo", "--no-browser", "--until-closed"],
}
AT_MOST_S = 360.0
# What `ldsim make` says before it runs a stage.
BEGINS = re.compile(rf"({'|'.join(STAGES)}): stage ")
MOVED = "Math.max(...ldsim.positions(0).map((x, i) => Math.abs(x - before[i]))) > {:g}"


def measured(part: str, folder: Path) -> dict[str, float]:
    """Seconds on the clock, of all and of each stage, and of the processors, that a part takes."""
    own = {"XDG_CACHE_HOME": str(folder / "cache")}
    unset = ("PYTHONDONTWRITEBYTECODE", "VIRTUAL_ENV", "MAKEFLAGS", "OMP_NUM_THREADS")
    environment = {name: value for name, value in os.environ.items() if name not in unset} | own
    place = folder if part == "clone" else folder / "ldsim"
    begun, before = time.perf_counter(), processors()
    since: dict[str, float] = {}
    with subprocess.Popen(
        PARTS[part], cwd=place, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if stage := BEGINS.match(line):
                since[stage[1]] = time.perf_counter()
            if part == "play" and line.startswith("http"):
                with pulled(line.strip()):
                    ended = time.perf_counter()
    assert process.returncode == 0, f"{PARTS[part]} ended with {process.returncode}"
    if part != "play":
        ended = time.perf_counter()
    times = [*since.values(), ended]
    stages = {stage: times[i + 1] - times[i] for i, stage in enumerate(since)}
    return {"clock": ended - begun, "processors": processors() - before} | stages


def processors() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@contextmanager
def pulled(
    url: str, size: tuple[int, int] = (1280, 800), least: float = 0.01, middle: float = 0.41
) -> Iterator[tuple[Tab, tuple[float, float]]]:
    """The page, where the solid has been dragged and has moved, at the upper middle or else at its right end.

    It is released when the block ends.

    Args:
        least: by which it has moved, m.
        middle: share of the page's height above which a vertex is the upper middle; 0 for the right end always.

    Yields:
        The tab, and where the pointer took hold, pixels.
    """
    with chromium() as tab:
        tab.size(*size)
        tab.open(url)
        tab.wait("window.ldsim !== undefined && ldsim.ready")
        at = tab.evaluate(
            f"""(() => {{ let right = null, around = [[0, 0], [6, 0], [-6, 0], [0, 6], [0, -6]]; // not at its rim
              before = Array.from(ldsim.positions(0));
              for (let i = 0; i < before.length / 3; i++) {{
                const [offsetX, offsetY] = ldsim.screen(0, i);
                if (right && offsetX <= right[0] && offsetY >= {middle * size[1]:g}) continue;
                const hit = ([x, y]) => ldsim.stage.hit({{ offsetX: offsetX + x, offsetY: offsetY + y }});
                if (!around.every(hit)) continue;
                if (offsetY < {middle * size[1]:g}) return [offsetX, offsetY];
                right = [offsetX, offsetY];
              }}
              return right; }})()"""
        )
        tab.mouse("mousePressed", at)
        for i in range(1, 9):
            tab.mouse("mouseMoved", (at[0] + 10 * i, at[1] - 8 * i))
        tab.wait(MOVED.format(least))
        yield tab, at
        tab.mouse("mouseReleased", at)


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("parts", nargs="*", choices=[*PARTS, []], help="some only")
    arguments.add_argument("--folder", type=Path, required=True, help="an empty one, or that of the parts before")
    given = arguments.parse_args()
    folder = given.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "measured.json"
    known = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    for part in given.parts or PARTS:
        known[part] = measured(part, folder)
        write_json(file, known)
    rows = [row(part, kind, seconds, "s") for part, found in known.items() for kind, seconds in found.items()]
    if set(known) == set(PARTS):
        rows += [
            row("all", kind, sum(each[kind] for each in known.values()), "s", f"<= {AT_MOST_S:g}" * (kind == "clock"))
            for kind in ("clock", "processors")
        ]
        write_results(NAME, f"python -m reproduction.bench.{NAME} --folder FOLDER", rows, inputs=["ldsim"])
    show(rows, "from clone to a solid under the pointer")


if __name__ == "__main__":
    main()
