"""What becomes of a trial: in a forked child, so that a crash is seen for what it is, or here, where none can be.

The parent imports and compiles once and every child has that from it, so a command costs what it does and no start.
"""

from __future__ import annotations

import gc
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from ldsim.cli.app import main as ldsim
from ldsim.errors import LdsimError
from ldsim.settings.make import MISSED

LIMIT = 120.0
FAULTS = ("silent", "traceback", "crash", "hang", "outside")
Trial = Callable[[], str]
# What writes, renames or removes: of these no path may lie outside the folders of the campaign.
CHANGES = ("os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.link", "os.symlink", "os.truncate")


def invoke(*words: object) -> Result:
    """A command in this process."""
    return CliRunner().invoke(ldsim, [str(word) for word in words])


def outcome(result: Result) -> str:
    """What came of a command; one that did its work and missed its tolerance is no refusal."""
    if result.exit_code in (0, MISSED):
        return "accepted"
    lines = [line for line in result.stderr.splitlines() if line.startswith(("error: ", "Error: "))]
    if isinstance(result.exception, SystemExit) and len(lines) == 1:
        return "refused"
    return f"traceback: {result.exception!r}"


def told(read: Callable[[], object]) -> str:
    """What came of a call of the library."""
    try:
        read()
    except LdsimError:
        return "refused"
    return "accepted"


def fork(trials: Sequence[Trial], within: tuple[Path, ...]) -> tuple[int, int]:
    """Begin trials in a child that leads a group of its own; returns its number and the pipe that it tells by."""
    reading, writing = os.pipe()
    gc.freeze()
    child = os.fork()
    if child:
        os.close(writing)
        return child, reading
    os.setsid()
    os.close(reading)
    sys.addaudithook(_watch(within))
    for trial in trials:
        try:
            said = trial()
        except BaseException as error:
            said = f"traceback: {error!r}"
        os.write(writing, said.encode()[:2000] + b"\0")
    os._exit(0)


def alone(trials: Sequence[Trial], limit: float = LIMIT, within: tuple[Path, ...] = ()) -> list[str]:
    """The outcomes of trials, one after another in a process of their own; where one ends it, it is the last.

    Args:
        limit: seconds after which one counts as hanging; those in which it waited for a processor that others had, or
            in which this process was stopped, do not count.
        within: folders outside which they may change nothing; none watches nothing.
    """
    child, reading = fork(trials, within)
    said, waited = b"", 0.0
    while said.count(b"\0") < len(trials) and waited < limit:
        started = time.monotonic() - starved(child)
        if select.select([reading], [], [], 0.5)[0]:
            piece, waited = os.read(reading, 1 << 16), 0.0
            said += piece
            if not piece:
                break
        waited += min(max(time.monotonic() - starved(child) - started, 0.0), 1.0)
    if waited >= limit:
        os.killpg(child, signal.SIGKILL)
    os.close(reading)
    _, status = os.waitpid(child, 0)
    outcomes = said.decode(errors="replace").split("\0")[:-1]
    if len(outcomes) < len(trials):
        outcomes.append("hang" if waited >= limit else f"crash: signal {os.WTERMSIG(status)}")
    return outcomes


def starved(process: int | str) -> float:
    """Seconds for which a process could run and had no processor, of its first thread."""
    with open(f"/proc/{process}/schedstat", encoding="ascii") as stream:
        return int(stream.read().split()[1]) * 1e-9


def here(trial: Trial) -> str:
    """The outcome of a trial of nothing compiled, which needs no process of its own."""

    def late(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    try:
        return trial()
    except TimeoutError:
        return "hang"
    except Exception as error:
        return f"traceback: {error!r}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _watch(within: tuple[Path, ...]) -> Callable[[str, tuple[Any, ...]], None]:
    """A hook that ends the process with words where it changes what lies outside some folders."""
    roots = tuple(os.path.realpath(folder) for folder in within)

    def hook(event: str, given: tuple[Any, ...]) -> None:
        if not roots or (event != "open" and event not in CHANGES):
            return
        if event == "open" and not (isinstance(given[1], str) and set(given[1]) & set("wxa+")):
            return
        if event != "open" and isinstance(given[-1], int) and given[-1] > 0:  # relative to a folder that is open
            return
        for path in given[: 2 if event in ("os.rename", "os.link") else 1]:
            if isinstance(path, str | os.PathLike) and not os.path.realpath(path).startswith(
                (*roots, "/dev/", "/proc/")
            ):
                raise AssertionError(f"outside: {event} {path}")

    return hook
