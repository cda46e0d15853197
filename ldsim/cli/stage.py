"""What every stage's command shares: its arguments, where the run's files lie, the header, time and memory."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Never

import click
from tqdm import tqdm

from ldsim import __version__
from ldsim.artefacts.store import Header, check_inputs, file_hash
from ldsim.errors import ArtefactError
from ldsim.pipeline.progress import Bar, Progress
from ldsim.settings import Settings, dump, load_settings, stage_settings

FILES = {
    "scene": "scene.h5",
    "snapshots": "snapshots.h5",
    "basis": "basis.h5",
    "model": "model.h5",
    "cubature": "cubature.h5",
    "simulation": "simulation.h5",
}


@dataclass
class Run:
    """One experiment's configuration and files."""

    config: Path
    settings: Settings
    folder: Path
    started: float = field(default_factory=time.perf_counter)

    def path(self, kind: str) -> Path:
        """The file of an artefact."""
        return self.folder / FILES[kind]

    def check(self, kind: str, header: Header, *inputs: str) -> None:
        """Refuse an artefact of another experiment, or made from other files than those of this run."""
        path = self.path(kind)
        experiment = header.notes.get("experiment")
        if experiment != self.settings.experiment:
            raise ArtefactError(
                f"{path} belongs to the experiment {experiment!r}, expected {self.settings.experiment!r}; run make"
            )
        check_inputs(path, header, {name: self.path(name) for name in inputs})

    def header(
        self, kind: str, stage: str, inputs: tuple[str, ...], seed: int = -1, **notes: str | float | int
    ) -> Header:
        """The header of the artefact that a stage writes."""
        return Header(
            kind,
            dump(stage_settings(self.settings, stage)),
            {name: file_hash(self.path(name)) for name in inputs},
            seed,
            {
                "experiment": self.settings.experiment,
                "stage": stage,
                "seconds": time.perf_counter() - self.started,
                "peak_memory_mb": peak_memory_mb(),
                **notes,
            },
        )

    def done(self, kind: str, summary: str) -> None:
        """Say what was written."""
        click.echo(f"{self.path(kind)}: {summary} ({time.perf_counter() - self.started:.1f} s)")


def peak_memory_mb() -> float:
    """Largest resident memory of this process or one of its workers so far, MB (10⁶ bytes)."""
    usage = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return usage * 1024 / 1e6


def stage_command(
    name: str, description: str, *options: click.Option
) -> Callable[[Callable[..., None]], click.Command]:
    """Make a click command of a function that takes the run, and the options that this stage alone has by name."""

    def wrap(function: Callable[..., None]) -> click.Command:
        @click.command(name, help=description)
        @click.argument("config", type=click.Path(path_type=Path))
        @click.version_option(__version__, "--version", prog_name="ldsim")
        @click.option("--runs", type=click.Path(path_type=Path), default=Path("runs"), help="Folder of all runs.")
        def command(config: Path, runs: Path, **values: object) -> None:
            settings = load_settings(config)
            function(Run(config, settings, runs / settings.experiment), **values)

        command.params += options
        return command

    return wrap


@contextmanager
def progress_bar(total: int | None, description: str, unit: str) -> Iterator[tqdm[Never]]:
    """A progress bar on stderr, slow to refresh where nobody watches."""
    interval = 0.2 if sys.stderr.isatty() else 10.0
    with tqdm(total=total, desc=description, unit=unit, mininterval=interval, dynamic_ncols=True, leave=True) as bar:
        yield bar


class Bars(Progress):
    """Progress as bars and notes on stderr."""

    @contextmanager
    def bar(self, description: str, total: int | None, unit: str) -> Iterator[Bar]:
        with progress_bar(total, description, unit) as bar:
            yield _Bar(bar)

    def tell(self, text: str) -> None:
        click.echo(text, err=True)


class _Bar(Bar):
    def __init__(self, bar: tqdm[Never]) -> None:
        self._bar = bar

    def update(self, steps: int = 1) -> None:
        self._bar.update(steps)

    def reach(self, steps: int) -> None:
        self._bar.update(steps - self._bar.n)

    def say(self, text: str) -> None:
        self._bar.set_postfix_str(text, refresh=False)
