"""Options of meshes that are made here."""

from __future__ import annotations

from typing import Annotated, Literal

from ldsim.options import Field, Options, Positive, exactly_one

# Cubes across the thinnest side, from Python as from a configuration.
RESOLUTION = 2


class ShapeOptions(Options):
    """A solid made by a rule."""

    name: Annotated[
        str,
        Field(description="A procedural shape: beam, mounted_bar, cross, slender_cross, catapult, pendulum, dumbbell."),
    ]
    resolution: Annotated[int, Field(ge=1, le=64, description="Cubes across the thinnest side.")] = RESOLUTION
    cell_type: Annotated[Literal["tet4", "hex8"], Field(description="Linear tetrahedra or trilinear hexahedra.")] = (
        "tet4"
    )


class SurfaceOptions(Options):
    """A closed triangle surface, filled with tets."""

    file: Annotated[str, Field(description="Triangle surface: .stl, .obj, .ply, .off and others.")]
    edge_length: Annotated[Positive | None, Field(description="Edges of the tets, about, m.")] = None
    cells: Annotated[int | None, Field(ge=10, description="Number of tets instead, about; takes up to five tries.")] = (
        None
    )
    envelope: Annotated[
        Positive | None,
        Field(description="How far the tets may be from the surface, m; left out, a twentieth of the edge length."),
    ] = None
    timeout: Annotated[float, Field(ge=1, description="Longest that one try may take, s.")] = 600.0

    _one = exactly_one("edge_length", "cells")
