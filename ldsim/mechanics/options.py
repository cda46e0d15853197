"""Options of motions. No heavy import: whoever only reads a configuration needs no compiler."""

from __future__ import annotations

from typing import Annotated

from ldsim.options import Field, Options, Positive, Seed


class PullOptions(Options):
    """Random pulls at the surface, one after another, each followed by free motion."""

    count: Annotated[int, Field(ge=1, description="Number of pulls, one after another.")]
    seed: Annotated[Seed, Field(description="Seed of where and which way.")] = 0
    reach: Annotated[Positive, Field(description="How far the pointer goes from the surface, m.")]
    stiffness: Annotated[Positive, Field(description="Of the spring, N/m.")] = 30.0
    radius: Annotated[Positive, Field(description="Vertices within it are held, m.")] = 0.03
    frames: Annotated[int, Field(ge=2, description="Frames of one pull.")] = 40
    rest: Annotated[int, Field(ge=0, description="Frames of free motion after each pull.")] = 40

    @property
    def frames_of_one(self) -> int:
        """Frames of a pull and of the free motion after it."""
        return self.frames + self.rest
