"""The section `mesh`: all that is physical."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ldsim.mechanics.materials import MaterialName
from ldsim.options import Options, Positive, Vector


class MaterialSettings(Options):
    model: MaterialName = Field("neo_hookean", description="Elastic energy density.")
    youngs_modulus: float = Field(gt=0, description="Young's modulus, Pa.")
    poisson_ratio: float = Field(0.47, gt=-1, lt=0.5, description="Poisson's ratio.")


class ShapeSettings(Options):
    name: str = Field(
        description="A procedural shape: beam, mounted_bar, cross, slender_cross, catapult, pendulum, dumbbell."
    )
    resolution: int = Field(2, ge=1, le=64, description="Cubes across the thinnest side.")
    cell_type: Literal["tet4", "hex8"] = Field("tet4", description="Linear tetrahedra or trilinear hexahedra.")


class SurfaceSettings(Options):
    """A closed triangle surface, filled with tets."""

    file: str = Field(description="Triangle surface: .stl, .obj, .ply, .off and others.")
    edge_length: Positive | None = Field(None, description="Edges of the tets, about, m.")
    cells: int | None = Field(None, ge=10, description="Number of tets instead, about; takes up to five tries.")
    envelope: Positive | None = Field(
        None, description="How far the tets may be from the surface, m; left out, a twentieth of the edge length."
    )
    timeout: float = Field(600.0, ge=1, description="Longest that one try may take, s.")

    @model_validator(mode="after")
    def _one(self) -> SurfaceSettings:
        if (self.edge_length is None) == (self.cells is None):
            raise ValueError("give exactly one of edge_length, cells")
        return self


class SlabSettings(Options):
    axis: Literal["x", "y", "z"] = Field(description="Axis across the slab.")
    at: Literal["min", "max"] = Field("min", description="Which end of the solid.")
    thickness: Positive = Field(description="Vertices within it of the end are pinned, m.")


class BallSettings(Options):
    centre: Vector = Field(description="Centre of the ball, m.")
    radius: Positive = Field(description="Vertices within it of the centre are pinned, m.")


class BoxSettings(Options):
    min: Vector = Field(description="Its corner of smallest coordinates, m.")
    max: Vector = Field(description="Its corner of largest coordinates, m.")

    @model_validator(mode="after")
    def _ordered(self) -> BoxSettings:
        if any(low > high for low, high in zip(self.min, self.max, strict=True)):
            raise ValueError(f"min {list(self.min)} must not be greater than max {list(self.max)} on any axis")
        return self


class RegionSettings(Options):
    """A part of the solid at rest."""

    slab: SlabSettings | None = Field(None, description="One end of the solid.")
    ball: BallSettings | None = Field(None, description="What lies in a ball.")
    box: BoxSettings | None = Field(None, description="What lies in a box with edges along the axes.")
    vertices: tuple[Annotated[int, Field(ge=0)], ...] | None = Field(
        None, min_length=1, description="These vertices, numbered from 0 as in scene.h5."
    )
    group: str | None = Field(None, description="A group of the mesh file; `ldsim info` of scene.h5 lists them.")

    @model_validator(mode="after")
    def _one(self) -> RegionSettings:
        if sum(getattr(self, name) is not None for name in RegionSettings.model_fields) != 1:
            raise ValueError(f"give exactly one of {', '.join(RegionSettings.model_fields)}")
        return self


class MaterialChangeSettings(Options):
    """What is different from the material so far; what is left out stays."""

    model: MaterialName | None = Field(None, description="Elastic energy density.")
    youngs_modulus: Positive | None = Field(None, description="Young's modulus, Pa.")
    youngs_factor: Positive = Field(1.0, description="Factor on Young's modulus.")
    poisson_ratio: float | None = Field(None, gt=-1, lt=0.5, description="Poisson's ratio.")


class MaterialRegionSettings(Options):
    where: RegionSettings = Field(description="Cells whose centroid lies in it, or that its list or group holds.")
    material: MaterialChangeSettings = MaterialChangeSettings()  # type: ignore[call-arg]
    density: Positive | None = Field(None, description="kg/m³.")


class CellDataSettings(Options):
    """Names of numbers that the mesh file gives to each cell."""

    youngs_modulus: str | None = Field(None, description="Young's modulus, Pa.")
    poisson_ratio: str | None = Field(None, description="Poisson's ratio.")
    density: str | None = Field(None, description="kg/m³.")


class LoadSettings(Options):
    """A force on a region that keeps its size and direction however the solid deforms."""

    where: RegionSettings = Field(description="Its cells, or the faces of the surface whose vertices all lie in it.")
    acceleration: Vector | None = Field(None, description="Of the cells, as gravity acts, m/s².")
    traction: Vector | None = Field(None, description="On the surface, force per area at rest, Pa.")
    pressure: float | None = Field(None, description="Against the surface at rest, Pa.")

    @model_validator(mode="after")
    def _one(self) -> LoadSettings:
        if sum(load is not None for load in (self.acceleration, self.traction, self.pressure)) != 1:
            raise ValueError("give exactly one of acceleration, traction, pressure")
        return self


class MeshSettings(Options):
    """The scene: all that is physical."""

    file: str | None = Field(None, description="Volume mesh in a format that meshio reads.")
    shape: ShapeSettings | None = Field(None, description="A procedural shape instead of a file.")
    surface: SurfaceSettings | None = Field(None, description="A closed triangle surface instead, filled with tets.")
    scale: Positive = Field(1.0, description="Factor from the file's unit to metres.")
    refine: int = Field(0, ge=0, le=4, description="Cut every tet into eight, this many times.")
    reorient: bool = Field(False, description="Flip left-handed cells instead of refusing them.")
    material: MaterialSettings
    density: Positive = Field(1000.0, description="kg/m³.")
    cell_data: CellDataSettings | None = Field(None, description="Material read from the mesh file, cell by cell.")
    regions: tuple[MaterialRegionSettings, ...] = Field((), description="Other material in parts; the last one wins.")
    pins: tuple[RegionSettings, ...] = Field(min_length=1, description="Vertices that do not move by themselves.")
    gravity: Vector = Field((0.0, -9.8, 0.0), description="Acceleration, m/s².")
    loads: tuple[LoadSettings, ...] = Field((), description="Forces besides gravity.")
    time_step: Positive = Field(0.005, description="h, s.")

    @model_validator(mode="after")
    def _one(self) -> MeshSettings:
        if [self.file, self.shape, self.surface].count(None) != 2:
            raise ValueError("give exactly one of file, shape, surface")
        if self.cell_data is not None and self.file is None:
            raise ValueError("cell_data is read from a mesh file; with a shape or a surface use regions")
        return self
