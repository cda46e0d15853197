"""From a surface file to pulling at it in the browser: two commands, no file edited; timed and filmed.

    python -m reproduction.bench.two_commands --folder /tmp/two           both commands, in an empty folder (minutes)
    python -m reproduction.bench.two_commands --folder /tmp/two --film    the film alone, of what was made there before

The commands run on a terminal, as a user's do, and every line that they print is kept with its time, those of bars too.
When the second one has printed its address, all that is kept; then the run is opened again by `ldsim play`, and in
Chromium the solid is pulled until it has moved. Kernels that this machine has compiled before are used. Results go to
reproduction/results/two_commands.json, and the film to docs/pictures/two_commands.webp: `make pictures` does not make
it, for that would take many minutes.
"""

from __future__ import annotations

import codecs
import json
import math
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import textwrap
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from matplotlib.font_manager import findfont
from PIL import Image, ImageDraw, ImageFont

from ldsim.pipeline.convergence import read_rounds
from ldsim.report.drawing import Picture, webp
from ldsim.report.overview import report_of
from ldsim.settings.make import MISSED
from reproduction.bench.newcomer import processors, pulled
from reproduction.bench.solid_files import write_solid
from reproduction.harness import Row, called, parser, row, show, write_json, write_results
from reproduction.pictures import PLAYGROUND, keep

NAME = "two_commands"
COMMANDS = {"new": "ldsim new part.stl", "make": "ldsim make part.yaml --error 5% --play"}
AGAIN, RUN = "ldsim play runs/part", Path("runs") / "part"
SHOWS = [*PLAYGROUND, "ldsim/cli/new.py", "ldsim/cli/make.py"]
PAGE, FILM = (960, 600), (720, 450)
ROWS, COLUMNS = 27, 104
FRAMES, PULLED = 24, 20  # of the browser; in so many of them the pointer holds the solid
FRAME_S, SCREENS, SCREEN_S, HOLD_S = 0.1, 10, 0.35, 0.9  # every screen of the terminal stays long enough to be read
GROUND, INK, FAINT = "#20262d", "#dde3e9", "#8a949e"


@dataclass(frozen=True)
class Line:
    """What stood in a line of the terminal.

    Attributes:
        second: when it was whole, since the first command was typed.
        stays: False of a bar, which is overwritten.
    """

    second: float
    text: str
    stays: bool = True


@contextmanager
def on_terminal(command: str, folder: Path, begun: float) -> Iterator[tuple[subprocess.Popen[bytes], Iterator[Line]]]:
    """A command on a terminal of its own, and the lines that it prints until it ends."""
    ours, its = pty.openpty()
    termios.tcsetwinsize(its, (ROWS, COLUMNS))
    words = [str(Path(sys.executable).with_name("ldsim")), *command.split()[1:]]
    own = {"BROWSER": "true", "TERM": "xterm"}  # Chromium is opened by who reads the address
    with subprocess.Popen(words, cwd=folder, env=os.environ | own, stdout=its, stderr=its) as process:
        os.close(its)
        yield process, _printed(ours, begun)
    os.close(ours)


def _printed(terminal: int, begun: float) -> Iterator[Line]:
    decoder, text = codecs.getincrementaldecoder("utf-8")("replace"), ""
    while data := _read(terminal):
        text += re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", decoder.decode(data))
        end = 0
        for found in re.finditer(r"([^\r\n]*)(\r*\n|\r+(?=[^\r\n]))", text):
            end = found.end()
            if found[1].strip() or "\n" in found[2]:
                yield Line(time.perf_counter() - begun, found[1].rstrip(), "\n" in found[2])
        text = text[end:]


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # all who write to it have ended
        return b""


def recorded(folder: Path) -> tuple[list[Line], dict[str, float]]:
    """Both commands, one after the other: their lines, and what was measured."""
    write_solid("bracket", folder).rename(folder / "part.stl")
    lines, measured, begun = list[Line](), dict[str, float](), time.perf_counter()
    for name, command in COMMANDS.items():
        start, before, count = time.perf_counter() - begun, processors(), len(lines)
        lines.append(Line(start, f"$ {command}"))
        with on_terminal(command, folder, begun) as (process, printed):
            for line in printed:
                lines.append(line)
                print(f"{line.second:8.1f} {line.text}" if line.stays else "", end="\n" * line.stays, flush=True)
                if line.text.startswith("http"):
                    process.send_signal(signal.SIGINT)
            measured[name] = _opened(lines[count:]) - start
        assert process.returncode in (0, MISSED), f"{command} ended with {process.returncode}"
        measured[f"{name} status"] = process.returncode
        measured[f"{name} processors"] = processors() - before
        measured[f"{name} lines"] = sum(each.stays for each in lines[count + 1 :])
    return lines, measured


def _opened(lines: Sequence[Line]) -> float:
    """When the address was printed, or else the last line."""
    return next((line.second for line in lines if line.text.startswith("http")), lines[-1].second)


def filmed(folder: Path) -> float:
    """Open the run again, pull at the solid, and take pictures meanwhile; returns the seconds until it had moved."""
    with on_terminal(AGAIN, folder, time.perf_counter()) as (process, printed):
        try:
            return _pulled_at(next(line.text for line in printed if line.text.startswith("http")), folder)
        finally:
            process.send_signal(signal.SIGINT)
            list(printed)


def _pulled_at(url: str, folder: Path) -> float:
    opened = time.perf_counter()
    with pulled(url, PAGE, middle=0.0) as (tab, at):
        moved = time.perf_counter() - opened
        for i in range(FRAMES):
            angle = 2 * math.pi * i / PULLED
            if i < PULLED:
                tab.mouse("mouseMoved", (at[0] + 80 * math.cos(angle), at[1] - 64 + 50 * math.sin(2 * angle)))
            elif i == PULLED:
                tab.mouse("mouseReleased", at)
            tab.picture(folder / f"frame_{i:02d}.png")
    return moved


def film(folder: Path, lines: Sequence[Line]) -> bytes:
    """The lines as they pass, much faster than they came, by a clock; then what the browser showed."""
    stops = _opened(lines) + 1
    # as many instants by the clock as by the lines: both hours of a bar and a burst of lines are seen
    half = SCREENS // 2
    staying = [line.second for line in lines if line.stays and line.second < stops]
    instants = [stops * (i + 1) / half for i in range(half)]
    instants += [staying[i * (len(staying) - 1) // (half - 1)] for i in range(half)]
    screens = [_screen(folder, lines, at) for at in sorted(instants)]
    pictures = [screen for screen in screens for _ in range(round(SCREEN_S / FRAME_S))]
    pictures += pictures[-1:] * round(HOLD_S / FRAME_S)
    pages = [Image.open(folder / f"frame_{i:02d}.png") for i in range(FRAMES)]
    pictures += [page.convert("RGB").resize(FILM, Image.Resampling.LANCZOS) for page in pages]
    return webp(pictures, FRAME_S)


def _screen(folder: Path, lines: Sequence[Line], second: float) -> Picture:
    """What the terminal shows then."""
    rows, bar = list[str](), ""
    for line in (each for each in lines if each.second <= second):
        text = line.text.replace(str(folder), "~")
        if line.stays:
            rows += textwrap.wrap(text, COLUMNS, subsequent_indent="  ") or [""]
        bar = "" if line.stays else text[:COLUMNS]
    picture = Image.new("RGB", FILM, GROUND)
    draw, font = ImageDraw.Draw(picture), ImageFont.truetype(findfont("DejaVu Sans Mono"), 11)
    draw.text((FILM[0] - 70, 6), f"{int(second) // 60:2d}:{int(second) % 60:02d} min", FAINT, font)
    for i, text in enumerate([*rows, bar][-ROWS:]):
        draw.text((12, 26 + 15.5 * i), text, INK if not text.startswith("$") else "#ffffff", font)
    return picture


def rows_of(folder: Path, measured: dict[str, float]) -> list[Row]:
    """What was measured, and what the report states."""
    numbers = report_of(folder / RUN)
    assert numbers is not None and numbers.statement is not None
    stated, latent = numbers.statement.latent, numbers.headline_runs()["latent"]
    step = None if latent.median_step_ms is None else 1000 * latent.median_step_ms
    return [
        row("bracket", "new", measured["new"], "s"),
        row("bracket", "make, until its address is printed", measured["make"], "s"),
        row("bracket", "address, until the first pull has moved it", measured["moved"], "s"),
        row("bracket", "all", measured["new"] + measured["make"] + measured["moved"], "s"),
        *(row("bracket", f"{name}, processors", measured[f"{name} processors"], "s") for name in COMMANDS),
        *(row("bracket", f"{name}, lines printed", measured[f"{name} lines"]) for name in COMMANDS),
        row("bracket", "threads", os.environ.get("OMP_NUM_THREADS", "all")),
        row("bracket", "load of the machine", measured["load"]),
        row("bracket", "cells", numbers.mesh.cells),
        row("bracket", "rounds", len(read_rounds(folder / RUN))),
        row("bracket", "stated error, latent", stated.error, "", "<= 0.05"),
        row("bracket", "median step, latent", step, "µs"),
        row("bracket", "exit status of make", measured["make status"]),
    ]


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument(
        "--folder", type=Path, required=True, help="an empty one, or for --film that of a call before"
    )
    arguments.add_argument("--film", action="store_true", help="only the film anew")
    given = arguments.parse_args()
    folder = given.folder.resolve()
    file = folder / "recorded.json"
    if not given.film:
        folder.mkdir(parents=True, exist_ok=True)
        assert not any(folder.iterdir()), f"{folder} is not empty"
        lines, measured = recorded(folder)
        measured["load"] = os.getloadavg()[2]
        write_json(file, {"lines": [asdict(each) for each in lines], "measured": measured})
    known = json.loads(file.read_text(encoding="utf-8"))
    lines, measured = [Line(**each) for each in known["lines"]], known["measured"] | {"moved": filmed(folder)}
    if not given.film:
        rows = rows_of(folder, measured)
        write_results(NAME, called(NAME), rows, inputs=["ldsim"])
        show(rows, "from a surface file to pulling at it")
    keep(f"{NAME}.webp", film(folder, lines), SHOWS)


if __name__ == "__main__":
    main()
