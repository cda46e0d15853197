"""What the commands of the stages share: their arguments, bars and notes on stderr, and what is said at the end."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal, Never, TypeVar, get_args, get_origin

import click
from tqdm import tqdm

from ldsim.cli.parameters import on_configuration
from ldsim.jit import while_compiling
from ldsim.options import Options
from ldsim.pipeline.progress import Bar, Progress
from ldsim.run import Run
from ldsim.settings import Settings, load_settings

COMPILING = "compiling, once"


class Bars(Progress):
    """Progress as bars, slow to refresh where nobody watches, and notes; both on stderr."""

    @contextmanager
    def bar(self, description: str, total: int | None, unit: str) -> Iterator[Bar]:
        interval = 0.2 if sys.stderr.isatty() else 10.0
        with tqdm(total=total, desc=description, unit=unit, mininterval=interval, dynamic_ncols=True) as shown:
            bar = _Bar(shown)
            with while_compiling(bar.compiling, bar.compiled):
                yield bar

    @contextmanager
    def opening(self, what: str) -> Iterator[None]:
        """Say what is opened, and why it takes long where kernels are compiled for it."""
        self.tell(f"opening {what}")
        with while_compiling(cache(lambda: self.tell(f"{COMPILING} on this machine")), lambda seconds: None):
            yield

    def tell(self, text: str) -> None:
        click.echo(text, err=True)


class _Bar(Bar):
    """A bar whose clock begins at the first step and stands still while kernels are compiled."""

    def __init__(self, bar: tqdm[Never]) -> None:
        self._bar, self._begun, self._said, self._told = bar, False, "", False

    def update(self, steps: int = 1) -> None:
        if self._begun or steps <= 0:
            self._bar.update(steps)
            return
        self._begun = True
        self._bar.n += steps
        self._bar.initial = self._bar.n
        self._bar.unpause()
        self._bar.start_t = self._bar.last_print_t
        self._bar.refresh()

    def reach(self, steps: int) -> None:
        self.update(int(steps - self._bar.n))

    def say(self, text: str) -> None:
        self._said = text
        self._bar.set_postfix_str(text, refresh=False)

    def compiling(self) -> None:
        """A kernel is being compiled, once for this machine."""
        self._bar.set_postfix_str(COMPILING, refresh=not self._told)
        self._told = True

    def compiled(self, seconds: float) -> None:
        """It is, and what it took is no measure of what is left."""
        self._bar.start_t += seconds
        self._bar.last_print_t += seconds
        self._bar.set_postfix_str(self._said, refresh=False)


@dataclass(frozen=True)
class Call:
    """A stage's command as it was called: the experiment, its run, and where its input files lie."""

    settings: Settings
    run: Run
    base: Path
    progress: Bars = field(default_factory=Bars)
    started: float = field(default_factory=time.perf_counter)

    def done(self, kind: str, summary: str) -> None:
        """Say what artefact was written."""
        self.say(self.run.path(kind), summary)

    def say(self, written: Path, summary: str) -> None:
        """Say what was written."""
        click.echo(f"{written}: {summary} ({time.perf_counter() - self.started:.1f} s)")


AnyFunction = TypeVar("AnyFunction", bound=Callable[..., None])


def flags_of(kind: type[Options]) -> Callable[[AnyFunction], AnyFunction]:
    """A command's options by the declaration of a class of options, which checks their ranges."""

    def wrap(function: AnyFunction) -> AnyFunction:
        for name, entry in reversed(kind.model_fields.items()):
            flag, kinds, said = f"--{name.replace('_', '-')}", _type(entry.annotation), entry.description
            function = click.option(flag, type=kinds, default=entry.default, show_default=True, help=said)(function)
        return function

    return wrap


def _type(annotation: object) -> click.ParamType[Any]:
    """What click makes of a type; for one that may be left out, of the other."""
    simple: dict[object, click.ParamType[Any]] = {
        int: click.INT,
        float: click.FLOAT,
        str: click.STRING,
        Path: click.Path(path_type=Path),
    }
    for each in (annotation, *get_args(annotation)):
        if get_origin(each) is Literal:
            return click.Choice(get_args(each))
    inner = [annotation, *get_args(annotation), *(each for some in get_args(annotation) for each in get_args(some))]
    return next(simple[each] for each in inner if each in simple)


def stage_command(
    name: str, description: str, *options: click.Option
) -> Callable[[Callable[..., None]], click.Command]:
    """Make a click command of a function that takes the call, and the options that this stage alone has by name."""

    def wrap(function: Callable[..., None]) -> click.Command:
        @on_configuration(name, description)
        def command(config: Path, runs: Path, **values: object) -> None:
            settings = load_settings(config)
            with Run(runs / settings.experiment, settings.experiment) as run:
                function(Call(settings, run, config.parent), **values)

        command.params += options
        return command

    return wrap
