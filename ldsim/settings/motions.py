"""The motions of the section `snapshot`: what pulls on the solid, and scripts of it."""

from __future__ import annotations

import itertools
from typing import Literal

from pydantic import Field, field_validator, model_validator

from ldsim.mechanics.options import PullOptions
from ldsim.options import Options, Positive, Vector
from ldsim.settings.scene import RegionSettings

MOTION_KINDS = ("recording", "pulls", "script", "script_file", "gravity_sweep", "release")


class KeyframeSettings(Options):
    time: float = Field(ge=0, description="Since the beginning of the motion, s.")


class TargetSettings(KeyframeSettings):
    target: Vector = Field(description="Where the pointer is, m.")


class PoseSettings(KeyframeSettings):
    translation: Vector = Field((0.0, 0.0, 0.0), description="From the rest pose, m.")
    angle: float = Field(0.0, description="Turn about the axis from the rest pose, degrees.")


class AccelerationSettings(KeyframeSettings):
    acceleration: Vector = Field(description="Gravity, m/s².")


class PathSettings(Options):
    """Keyframes in time, and how to go from one to the next."""

    interpolation: Literal["eased", "linear"] = Field(
        "eased", description="Eased: each stretch starts and ends at rest; linear: at constant speed."
    )
    keyframes: tuple[KeyframeSettings, ...]

    @field_validator("keyframes")
    @classmethod
    def _a_path(cls, keyframes: tuple[KeyframeSettings, ...]) -> tuple[KeyframeSettings, ...]:
        if len(keyframes) < 2:
            raise ValueError(f"a path needs at least two keyframes, got {len(keyframes)}")
        times = [keyframe.time for keyframe in keyframes]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"the times of keyframes must rise, got {times}")
        return keyframes


class GrabSettings(PathSettings):
    point: Vector = Field(description="Where it takes hold, m.")
    at_rest: bool = Field(True, description="Whether the point is on the rest shape; false: on the deformed one.")
    stiffness: Positive = Field(30.0, description="Of the spring, N/m.")
    radius: Positive = Field(0.03, description="Vertices within it are held, m.")
    keyframes: tuple[TargetSettings, ...] = Field(description="Held from the first to the last, then let go.")


class MovingPinsSettings(PathSettings):
    where: RegionSettings = Field(description="Which of the pinned vertices.")
    axis: Vector = Field((0.0, 0.0, 1.0), description="Axis of the turn.")
    centre: Vector | None = Field(None, description="A point on the axis, m; left out, the middle of the vertices.")
    keyframes: tuple[PoseSettings, ...] = Field(description="The first must be the rest pose.")


class GravitySettings(PathSettings):
    keyframes: tuple[AccelerationSettings, ...] = Field(description="Gravity before, between and after them.")


class ScriptSettings(Options):
    """What happens at what time; grabs, moving pins and gravity may go together."""

    grabs: tuple[GrabSettings, ...] = Field((), description="Pulls of the pointer.")
    moving_pins: tuple[MovingPinsSettings, ...] = Field((), description="Pinned regions that follow a path.")
    gravity: GravitySettings | None = Field(None, description="Gravity that changes.")
    duration: Positive | None = Field(None, description="Length of the motion, s; left out, until the last keyframe.")

    @model_validator(mode="after")
    def _something(self) -> ScriptSettings:
        if not (self.grabs or self.moving_pins or self.gravity):
            raise ValueError("give at least one of grabs, moving_pins, gravity")
        return self


class GravitySweepSettings(Options):
    duration: Positive = Field(description="s.")
    turns: int = Field(4, ge=1, description="Turns of the spiral from the scene's gravity to its opposite.")
    size: Positive | None = Field(None, description="Of the acceleration, m/s²; left out, that of the scene's gravity.")


class ReleaseSettings(Options):
    """A grab that takes the solid slowly into a pose, waits until it is still, and lets go."""

    point: Vector = Field(description="Where it takes hold, on the rest shape, m.")
    target: Vector = Field(description="Where it takes the point, m.")
    stiffness: Positive = Field(300.0, description="Of the spring, N/m.")
    radius: Positive = Field(0.03, description="Vertices within it are held, m.")
    pull: Positive = Field(0.5, description="Time to get there, s.")
    hold: float = Field(0.5, ge=0, description="Time to come to rest there, s.")
    swing: Positive = Field(1.0, description="Time of free motion after that, s.")


class MotionSettings(Options):
    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", description="Name of the motion in every artefact.")
    role: Literal["train", "heldout"] | None = Field(
        None, description="Whether the model may learn from it; left out, train, or as heldout_share chooses."
    )
    recording: str | None = Field(None, description="CSV of a recorded interaction.")
    pulls: PullOptions | None = Field(None, description="Seeded random pulls.")
    script: ScriptSettings | None = Field(None, description="Keyframes of grabs, moving pins and gravity.")
    script_file: str | None = Field(None, description="The same in a YAML file of its own.")
    gravity_sweep: GravitySweepSettings | None = Field(None, description="Gravity from every direction in turn.")
    release: ReleaseSettings | None = Field(None, description="Into a pose by a grab, then let go.")
    frames: int | None = Field(None, ge=1, description="Use only the first frames.")

    @model_validator(mode="after")
    def _one(self) -> MotionSettings:
        if sum(getattr(self, kind) is not None for kind in MOTION_KINDS) != 1:
            raise ValueError(f"give exactly one of {', '.join(MOTION_KINDS)}")
        return self
