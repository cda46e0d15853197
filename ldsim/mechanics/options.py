"""Options of materials, loads and motions. No heavy import: whoever only reads a configuration needs no compiler."""

from __future__ import annotations

import itertools
from typing import Annotated, Literal

from ldsim.mechanics.materials import MaterialName
from ldsim.mechanics.regions import Region
from ldsim.options import Field, Options, Positive, Seed, Vector, exactly_one, field_validator, model_validator

# Of one motion.
MOST_FRAMES = 1_000_000

PoissonRatio = Annotated[float, Field(gt=-1, lt=0.5)]
# What a kilogram weighs where a tolerance is a share of a weight, N.
EARTH = 9.8


class MaterialOptions(Options):
    """The material of the whole solid."""

    model: Annotated[MaterialName, Field(description="Elastic energy density.")] = "neo_hookean"
    youngs_modulus: Annotated[Positive, Field(description="Young's modulus, Pa.")]
    poisson_ratio: Annotated[PoissonRatio, Field(description="Poisson's ratio.")] = 0.47


class MaterialChangeOptions(Options):
    """What is different from the material so far; what is left out stays."""

    model: Annotated[MaterialName | None, Field(description="Elastic energy density.")] = None
    youngs_modulus: Annotated[Positive | None, Field(description="Young's modulus, Pa.")] = None
    youngs_factor: Annotated[Positive, Field(description="Factor on Young's modulus.")] = 1.0
    poisson_ratio: Annotated[PoissonRatio | None, Field(description="Poisson's ratio.")] = None


class MaterialRegionOptions(Options):
    """Another material in a region."""

    where: Annotated[Region, Field(description="Cells whose centroid lies in it, or that its list or group holds.")]
    material: MaterialChangeOptions = MaterialChangeOptions()
    density: Annotated[Positive | None, Field(description="kg/m³.")] = None


class CellDataOptions(Options):
    """Names of numbers that the mesh file gives to each cell."""

    youngs_modulus: Annotated[str | None, Field(description="Young's modulus, Pa.")] = None
    poisson_ratio: Annotated[str | None, Field(description="Poisson's ratio.")] = None
    density: Annotated[str | None, Field(description="kg/m³.")] = None


class LoadOptions(Options):
    """A force on a region that keeps its size and direction however the solid deforms."""

    where: Annotated[Region, Field(description="Its cells, or the faces of the surface whose vertices all lie in it.")]
    acceleration: Annotated[Vector | None, Field(description="Of the cells, as gravity acts, m/s².")] = None
    traction: Annotated[Vector | None, Field(description="On the surface, force per area at rest, Pa.")] = None
    pressure: Annotated[float | None, Field(description="Against the surface at rest, Pa.")] = None

    _one = exactly_one("acceleration", "traction", "pressure")


class PullOptions(Options):
    """Random pulls at the surface, one after another, each followed by free motion."""

    count: Annotated[int, Field(ge=1, le=10_000, description="Number of pulls, one after another.")]
    seed: Annotated[Seed, Field(description="Seed of where and which way.")] = 0
    reach: Annotated[Positive, Field(description="How far the pointer goes from the surface, m.")]
    stiffness: Annotated[Positive, Field(description="Of the spring, N/m.")] = 30.0
    radius: Annotated[Positive, Field(description="Vertices within it are held, m.")] = 0.03
    frames: Annotated[int, Field(ge=2, le=100_000, description="Frames of one pull.")] = 40
    rest: Annotated[int, Field(ge=0, le=100_000, description="Frames of free motion after each pull.")] = 40

    @model_validator(mode="after")
    def _of_a_length(self) -> PullOptions:
        frames = self.count * self.frames_of_one
        if frames > MOST_FRAMES:
            raise ValueError(f"{self.count} pulls of {self.frames_of_one} frames are {frames}; at most {MOST_FRAMES}")
        return self

    @property
    def frames_of_one(self) -> int:
        """Frames of a pull and of the free motion after it."""
        return self.frames + self.rest


class Keyframe(Options):
    time: Annotated[float, Field(ge=0, description="Since the beginning of the motion, s.")]


class TargetKeyframe(Keyframe):
    target: Annotated[Vector, Field(description="Where the pointer is, m.")]


class PoseKeyframe(Keyframe):
    translation: Annotated[Vector, Field(description="From the rest pose, m.")] = (0.0, 0.0, 0.0)
    angle: Annotated[float, Field(description="Turn about the axis from the rest pose, degrees.")] = 0.0


class AccelerationKeyframe(Keyframe):
    acceleration: Annotated[Vector, Field(description="Gravity, m/s².")]


class PathOptions(Options):
    """Keyframes in time, and how to go from one to the next."""

    interpolation: Annotated[
        Literal["eased", "linear"],
        Field(description="Eased: each stretch starts and ends at rest; linear: at constant speed."),
    ] = "eased"
    keyframes: tuple[Keyframe, ...]

    @property
    def eased(self) -> bool:
        """Whether each stretch starts and ends at rest."""
        return self.interpolation == "eased"

    @field_validator("keyframes")
    @classmethod
    def _a_path(cls, keyframes: tuple[Keyframe, ...]) -> tuple[Keyframe, ...]:
        if len(keyframes) < 2:
            raise ValueError(f"a path needs at least two keyframes, got {len(keyframes)}")
        times = [keyframe.time for keyframe in keyframes]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"the times of keyframes must rise, got {times}")
        return keyframes


class GrabOptions(PathOptions):
    """A pull of the pointer along a path."""

    point: Annotated[Vector, Field(description="Where it takes hold, m.")]
    at_rest: Annotated[
        bool, Field(description="Whether the point is on the rest shape; false: on the deformed one.")
    ] = True
    stiffness: Annotated[Positive, Field(description="Of the spring, N/m.")] = 30.0
    radius: Annotated[Positive, Field(description="Vertices within it are held, m.")] = 0.03
    keyframes: Annotated[tuple[TargetKeyframe, ...], Field(description="Held from the first to the last, then let go.")]


class MovingPinsOptions(PathOptions):
    """Pinned vertices that follow a path."""

    where: Annotated[Region, Field(description="Which of the pinned vertices.")]
    axis: Annotated[Vector, Field(description="Axis of the turn.")] = (0.0, 0.0, 1.0)
    centre: Annotated[
        Vector | None, Field(description="A point on the axis, m; left out, the middle of the vertices.")
    ] = None
    keyframes: Annotated[tuple[PoseKeyframe, ...], Field(description="The first must be the rest pose.")]


class GravityPathOptions(PathOptions):
    """Gravity that changes."""

    keyframes: Annotated[tuple[AccelerationKeyframe, ...], Field(description="Gravity before, between and after them.")]


class ScriptOptions(Options):
    """What happens at what time; grabs, moving pins and gravity may go together."""

    grabs: Annotated[tuple[GrabOptions, ...], Field(description="Pulls of the pointer.")] = ()
    moving_pins: Annotated[tuple[MovingPinsOptions, ...], Field(description="Pinned regions that follow a path.")] = ()
    gravity: Annotated[GravityPathOptions | None, Field(description="Gravity that changes.")] = None
    duration: Annotated[
        Positive | None, Field(description="Length of the motion, s; left out, until the last keyframe.")
    ] = None

    @model_validator(mode="after")
    def _something(self) -> ScriptOptions:
        if not (self.grabs or self.moving_pins or self.gravity):
            raise ValueError("give at least one of grabs, moving_pins, gravity")
        return self


class GravitySweepOptions(Options):
    """Gravity from every direction in turn."""

    duration: Annotated[Positive, Field(description="s.")]
    turns: Annotated[
        int, Field(ge=1, le=1000, description="Turns of the spiral from the scene's gravity to its opposite.")
    ] = 4
    size: Annotated[
        Positive | None, Field(description="Of the acceleration, m/s²; left out, that of the scene's gravity.")
    ] = None


class ReleaseOptions(Options):
    """A grab that takes the solid slowly into a pose, waits until it is still, and lets go."""

    point: Annotated[Vector, Field(description="Where it takes hold, on the rest shape, m.")]
    target: Annotated[Vector, Field(description="Where it takes the point, m.")]
    stiffness: Annotated[Positive, Field(description="Of the spring, N/m.")] = 300.0
    radius: Annotated[Positive, Field(description="Vertices within it are held, m.")] = 0.03
    pull: Annotated[Positive, Field(description="Time to get there, s.")] = 0.5
    hold: Annotated[float, Field(ge=0, description="Time to come to rest there, s.")] = 0.5
    swing: Annotated[Positive, Field(description="Time of free motion after that, s.")] = 1.0
