"""What several commands take: a run, a configuration, a server's options, percentages, and the look of pictures."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

run_argument = click.argument("run", type=click.Path(path_type=Path))
RUNS = Path("runs")
runs_option = click.option("--runs", type=click.Path(path_type=Path), default=RUNS, help="Folder of all runs.")


def on_configuration(name: str, description: str) -> Callable[[Callable[..., None]], click.Command]:
    """Make a command of a function that takes a configuration, the folder of all runs, and its own options."""
    config = click.argument("config", type=click.Path(path_type=Path))
    return lambda function: click.command(name, help=description)(config(runs_option(function)))


port_option = click.option("--port", type=click.IntRange(0, 65535), default=0, help="0 for any that is free.")
browser_option = click.option("--browser/--no-browser", default=True, help="Open the page in the browser.")
until_closed_option = click.option("--until-closed", is_flag=True, help="End when the page is closed.")


class Finite(click.FloatRange):
    """A number of a range, which `nan` and `inf` are not."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        found: float = super().convert(value, param, ctx)
        if not math.isfinite(found):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return found


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


def asked_options(function: Callable[..., None]) -> Callable[..., None]:
    """What `ldsim make` is asked for, beside what it makes."""
    error = click.option(
        "--error",
        type=Percent(),
        metavar="PERCENT",
        help="Learn until it is held; with the report made, status 3 where it is not.",
    )
    minutes = click.option(
        "--minutes",
        type=Finite(min=0),
        default=20.0,
        show_default=True,
        help="From the call on; no round begins that would end later.",
    )
    step = click.option(
        "--step",
        type=Finite(min=0),
        metavar="MICROSECONDS",
        help="With the report made, status 3 where a step is slower.",
    )
    experiment = click.option("--experiment", help="Refuse a configuration of another experiment (for the Makefile).")
    return error(minutes(step(experiment(function))))


class Size(click.ParamType[tuple[int, int]]):
    """Width and height of a picture, pixels."""

    name = "WxH"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        found = re.fullmatch(r"(\d+)[x×](\d+)", str(value))
        width, height = (int(found[1]), int(found[2])) if found else (0, 0)
        if not (64 <= width <= 7680 and 64 <= height <= 7680):
            self.fail(f"{value!r} is no size of 64 to 7680 pixels each way, such as 1280x720", param, ctx)
        return width, height


class Angles(click.ParamType[tuple[float, float]]):
    """From where a solid is seen: azimuth and elevation, degrees, or a word."""

    name = "A,E"
    WORDS = {"front": (0.0, 0.0), "side": (90.0, 0.0), "top": (0.0, 90.0)}

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        if str(value) in self.WORDS:
            return self.WORDS[str(value)]
        try:
            azimuth, elevation = (float(number) for number in str(value).split(","))
        except ValueError:
            azimuth = elevation = math.nan
        if not (abs(azimuth) <= 360 and abs(elevation) <= 90):
            self.fail(
                f"{value!r} is no view: give azimuth,elevation in degrees, such as 30,15, or {', '.join(self.WORDS)}",
                param,
                ctx,
            )
        return azimuth, elevation
