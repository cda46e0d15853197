"""What several commands take: a configuration and the folder of all runs, a percentage."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import click

from ldsim import __version__

AnyFunction = TypeVar("AnyFunction", bound=Callable[..., None])


def on_configuration(name: str, description: str) -> Callable[[AnyFunction], click.Command]:
    """Make a click command of a function that takes a configuration, the folder of all runs, and its own options."""

    def wrap(function: AnyFunction) -> click.Command:
        runs = click.option("--runs", type=click.Path(path_type=Path), default=Path("runs"), help="Folder of all runs.")
        version = click.version_option(__version__, "--version", prog_name="ldsim")
        config = click.argument("config", type=click.Path(path_type=Path))
        return click.command(name, help=description)(config(version(runs(function))))

    return wrap


class Percent(click.ParamType[float]):
    """A share above 0, said in percent, with or without the sign."""

    name = "percent"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            found = float(str(value).strip().removesuffix("%"))
        except ValueError:
            found = 0.0
        if not 0 < found < math.inf:
            self.fail(f"{value!r} is no percentage above 0, such as 5 or 5%", param, ctx)
        return found
