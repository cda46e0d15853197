"""Which reduced space to use for a solid: error against time, over the same frames of the same motions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ldsim.dynamics.trajectory import Trajectory

Runs = Mapping[str, Mapping[str, Trajectory]]

LATENT = "latent"
# A space whose error is at most so many times the least is good enough for the faster step to decide.
NEARLY = 1.5


@dataclass(frozen=True)
class Standing:
    """How a space did on some motions together.

    Attributes:
        space: its name in simulation.h5, such as linear_20.
        error: the online error over all of their frames; infinite where a run was lost.
        seconds: the median of all steps.
    """

    space: str
    error: float
    seconds: float


def standings(runs: Runs, motions: Sequence[str]) -> list[Standing]:
    """Every reduced space that ran all of some motions, in the order of its runs; none where no error is known."""
    ran = {space: [own[name] for name in motions if name in own] for space, own in runs.items() if space != "full"}
    return [
        Standing(space, error, float(np.nanmedian(np.concatenate([each.seconds for each in own]))))
        for space, own in ran.items()
        if len(own) == len(motions) > 0 and (error := error_of(own)) is not None
    ]


def error_of(trajectories: Sequence[Trajectory]) -> float | None:
    """Mean vertex distance over all frames of several runs over the mean displacement; infinite where one was lost."""
    errors = [each.mean_error for each in trajectories]
    moved = [each.mean_displacement for each in trajectories]
    if any(each is None for each in (*errors, *moved)):
        return None
    if any(each.diverged for each in trajectories):
        return math.inf
    distance, path = (sum(float(each.sum()) for each in some if each is not None) for some in (errors, moved))
    return distance / path if path > 0 else None


def judging(roles: Mapping[str, str], order: Sequence[str]) -> list[str]:
    """The motions of the first of some roles that any motion has."""
    found = ([name for name, role in roles.items() if role == wanted] for wanted in order)
    return next((names for names in found if names), [])


def chosen_space(found: Sequence[Standing]) -> str:
    """The fastest of the spaces that are nearly as good as the best; latent where nothing is known."""
    least = min((each.error for each in found), default=math.inf)
    near = [each for each in found if each.error <= NEARLY * least < math.inf]
    return min(near, key=lambda each: each.seconds).space if near else LATENT


def equal_error(found: Sequence[Standing]) -> tuple[Standing | None, Standing | None, Standing | None]:
    """The latent space, the fastest linear one that is at least as good, and the linear one of least error."""
    latent = next((each for each in found if each.space == LATENT), None)
    linear = [each for each in found if each.space != LATENT]
    best = min(linear, key=lambda each: each.error, default=None)
    if latent is None or not math.isfinite(latent.error):
        return latent, None, best
    equal = [each for each in linear if each.error <= latent.error]
    return latent, min(equal, key=lambda each: each.seconds, default=None), best
