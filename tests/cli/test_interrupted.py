"""Ctrl+C: said once, in one line, and told to the shell by status 130."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import pytest
from click.testing import CliRunner

from ldsim.cli import settings
from ldsim.cli.app import main
from ldsim.errors import INTERRUPTED
from ldsim.settings import make
from tests.cli.experiments import TINY, Experiment

SAID = "interrupted; what was finished is kept, and the same command goes on from there\n"


def interrupted(*_: object) -> NoReturn:
    raise KeyboardInterrupt


def test_a_command_says_so_in_one_line_and_ends_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settings, "load_settings", interrupted)
    result = CliRunner().invoke(main, ["settings", "any.yaml"])
    assert (result.exit_code, result.output) == (128 + signal.SIGINT, SAID)


def heed_interrupts() -> None:
    """A shell starts background jobs, and so perhaps these tests, with SIGINT ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_of_make_and_its_stage_one_says_so(tmp_path: Path) -> None:
    """Ctrl+C reaches both at once."""
    experiment = Experiment(tmp_path)
    motion = {"name": "a", "pulls": {"count": 900, "seed": 1, "reach": 0.08, "frames": 12, "rest": 8}}
    experiment.change("snapshot.motions", [motion])
    command = [sys.executable, "-m", "ldsim", "make", str(experiment.config), "--runs", str(tmp_path / "runs")]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    process = subprocess.Popen(command, start_new_session=True, preexec_fn=heed_interrupts, **pipes)  # type: ignore[call-overload]
    while not process.stdout.readline().startswith("full space: "):  # its stage snapshot says so
        assert process.poll() is None
    os.killpg(process.pid, signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert process.returncode in make.BY_CTRL_C
    assert out.count("interrupted") == 1 and out.endswith(SAID)
    assert "Aborted" not in out and "Traceback" not in out


@pytest.mark.parametrize("status", [INTERRUPTED, -signal.SIGINT])
def test_a_stage_that_was_interrupted_is_no_failure_to_go_on_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, status: int
) -> None:
    """As a round of learning does after one."""
    monkeypatch.setattr(make, "status_of", lambda command: status)
    experiment = Experiment(tmp_path)
    experiment.configure(TINY)
    with pytest.raises(make.StageInterrupted):
        make.make(experiment.config, tmp_path / "runs", "mesh", lambda line: None)


@pytest.fixture
def heeded() -> Iterator[None]:
    """Interruptions reach these tests, even where they run in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupting(rest: str) -> list[str]:
    """A stage while which its caller is interrupted."""
    return [sys.executable, "-c", f"import os, signal, sys, time; os.kill(os.getppid(), signal.SIGINT); {rest}"]


@pytest.mark.parametrize(
    ("end", "status"),
    [
        (f"sys.exit({INTERRUPTED})", INTERRUPTED),
        ("signal.signal(signal.SIGINT, signal.SIG_DFL); signal.raise_signal(signal.SIGINT)", -signal.SIGINT),
    ],
    ids=["exits", "by the signal"],
)
def test_a_stage_has_time_to_tell_of_it(heeded: None, end: str, status: int) -> None:
    assert make.status_of(interrupting(f"time.sleep(1); {end}")) == status


def test_a_stage_that_does_not_end_is_ended_and_the_command_tells_of_it(
    heeded: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(make, "TO_END_S", 0.1)
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        make.status_of(interrupting("time.sleep(100)"))
    assert time.monotonic() - begun < 50
