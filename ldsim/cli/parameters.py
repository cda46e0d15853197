"""Types of what commands take."""

from __future__ import annotations

import math

import click


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
