"""How a reduced step is taken."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from ldsim.mechanics.options import EARTH
from ldsim.options import Field, Options

# Where a reduced step stops unless told: at a gradient of this share of the solid's weight on earth. It then goes on by
# a direction more, so a tighter stop takes longer and moves no digit of the online error that one could see.
SHARE_OF_WEIGHT = 3e-3


class MinimiserOptions(Options):
    """Which minimiser takes the reduced steps; the paper's is lbfgs with current, inertia and extrapolate off and
    every_step and wolfe on."""

    method: Annotated[
        Literal["bfgs", "lbfgs", "newton"],
        Field(description="BFGS kept across steps, L-BFGS of eight pairs (paper, Sec. 5.2), or Newton."),
    ] = "bfgs"
    current: Annotated[
        bool, Field(description="Precondition with the tangent at a state of the motion, not with that at rest.")
    ] = True
    inertia: Annotated[
        bool, Field(description="Inertia in the preconditioner at rest; false is the paper's Eq. 15, JᵀK̃₀J.")
    ] = True
    every_step: Annotated[
        bool, Field(description="Make the preconditioner anew in every step; else where it has become bad.")
    ] = False
    extrapolate: Annotated[
        bool, Field(description="Start a step where earlier ones lead to; false starts it at the last state.")
    ] = True
    wolfe: Annotated[
        bool, Field(description="A line search that also asks for the weak Wolfe condition, by bisection.")
    ] = False


class ReducedOptions(MinimiserOptions):
    """How a reduced step is taken."""

    tolerance: Annotated[
        float | None,
        Field(
            gt=0,
            description="Stop at ‖∇E‖ ≤ tolerance · max(‖z‖, 1), N; left out, 0.3 % of the solid's weight, and of one "
            "of more than a kilogram less, by the root of its mass.",
        ),
    ] = None
    max_iterations: Annotated[int, Field(ge=1, description="Of one reduced step.")] = 200
    quasistatic: Annotated[bool, Field(description="Leave inertia out: every step leads to an equilibrium.")] = False

    def stop(self, mass: float) -> float:
        """The tolerance, N, for a solid of so many kg.

        In coordinates that are orthonormal in the mass a weight is no more than g √mass: of solids of tons 0.3 % of
        the weight would be more than all that acts on them.
        """
        return SHARE_OF_WEIGHT * EARTH * min(mass, math.sqrt(mass)) if self.tolerance is None else self.tolerance
