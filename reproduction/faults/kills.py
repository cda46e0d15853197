"""Stages killed at random moments and run again: the same datasets as those of the undisturbed run."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from functools import partial

import numpy as np

from ldsim.settings import STAGES
from reproduction.faults.alone import fork
from reproduction.faults.artefacts import Found
from reproduction.faults.bench import EXPERIMENTS, WRITES, Bench, same

# Seconds within which a stage is killed; most need less, and a kill that comes too late does not count. One kill in so
# many is of a command started anew, not of a forked one.
LATEST, ANEW, START = 2.5, 12, 8.0
_TOOK: dict[tuple[str, str], float] = {}


def kills(bench: Bench, rng: np.random.Generator) -> Found:
    """A stage, killed, once more killed perhaps, and then run to its end."""
    name, stage = str(rng.choice(EXPERIMENTS)), str(rng.choice(STAGES[:-1]))
    run = bench.copy(name)
    artefact = run / f"{WRITES[stage]}.h5"
    if rng.random() < 0.7:
        artefact.unlink()
    for _ in range(int(rng.integers(1, 3))):
        killed = _anew(bench, stage, name, rng) if rng.integers(ANEW) == 0 else _forked(bench, stage, name, rng)
        if killed:
            yield "kills", "killed", ""
    (said,) = bench.alone(partial(bench.stage, stage, name, bench.made))
    if said != "accepted":
        yield "runs after kills", f"traceback: {said}", f"{stage} of {name}"
    elif not same(artefact, bench.whole / name / artefact.name):
        yield "runs after kills", "silent", f"{stage} of {name}"
    elif left := sorted(path.name for path in run.iterdir() if path.name.startswith(".")):
        yield "runs after kills", f"silent: left {left}", f"{stage} of {name}"
    else:
        yield "runs after kills", "the same", ""


def _forked(bench: Bench, stage: str, name: str, rng: np.random.Generator) -> bool:
    """Kill a forked command at a moment before its usual end; whether it still ran."""
    started = time.monotonic()
    child, reading = fork([partial(bench.stage, stage, name, bench.made)], ())
    time.sleep(float(rng.uniform(0.0, _TOOK.get((stage, name), LATEST))))
    done, _ = os.waitpid(child, os.WNOHANG)
    if done:
        _TOOK[stage, name] = time.monotonic() - started
    else:
        with contextlib.suppress(ProcessLookupError):  # so young that it leads no group yet
            os.killpg(child, signal.SIGKILL)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    os.close(reading)
    return not done


def _anew(bench: Bench, stage: str, name: str, rng: np.random.Generator) -> bool:
    words = [sys.executable, "-m", "ldsim", stage, str(bench.config(name)), "--runs", str(bench.made)]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(words, start_new_session=True, stdout=quiet, stderr=quiet) as process:
        time.sleep(float(rng.uniform(1.0, START)))
        running = process.poll() is None
        if running:
            os.killpg(process.pid, signal.SIGKILL)
    return running
