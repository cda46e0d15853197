"""The options of a report."""

from __future__ import annotations

from typing import Annotated

from ldsim.options import Field, Options


class ReportOptions(Options):
    """What the report shows."""

    pictures: Annotated[int, Field(ge=0, le=12, description="Moments to show, full beside linear and latent.")] = 3
