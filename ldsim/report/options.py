"""The options of a report."""

from __future__ import annotations

from typing import Annotated

from ldsim.options import Field, Options


class ReportOptions(Options):
    """What the report shows."""

    pictures: Annotated[bool, Field(description="Whether the page shows motions: a replay, and an animation.")] = True
