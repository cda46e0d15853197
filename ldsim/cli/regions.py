"""Regions of a configuration as the mechanics knows them; for the commands that read some."""

from __future__ import annotations

from ldsim.mechanics.regions import Ball, Box, NamedGroup, Region, Slab, VertexList
from ldsim.settings import RegionSettings


def region(settings: RegionSettings) -> Region:
    """The region that a configuration describes."""
    if settings.slab is not None:
        return Slab(settings.slab.axis, settings.slab.at == "max", settings.slab.thickness)
    if settings.ball is not None:
        return Ball(settings.ball.centre, settings.ball.radius)
    if settings.box is not None:
        return Box(settings.box.min, settings.box.max)
    if settings.vertices is not None:
        return VertexList(settings.vertices)
    assert settings.group is not None
    return NamedGroup(settings.group)
