"""How the look of pictures is said."""

from __future__ import annotations

import math
import re

import click


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
