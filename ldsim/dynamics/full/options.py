"""The options of the full-space solver."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from ldsim.arrays import Array
from ldsim.mechanics.options import EARTH
from ldsim.options import Field, Options

# Where no tolerance is given: N, and between which shares of the norm of the weights of all vertices it stays.
USUAL, SHARES_OF_WEIGHTS = 1e-6, (1e-7, 1e-2)


class FullOptions(Options):
    """How a step of the full space is solved."""

    tolerance: Annotated[
        float | None,
        Field(
            gt=0,
            description="Stop at ‖∇E‖ ≤ tolerance · max(‖u‖, 1), N; left out, 10⁻⁶, at most 1 % of the norm of the "
            "weights of the vertices and at least 10⁻⁷ of it.",
        ),
    ] = None
    method: Annotated[Literal["lbfgs", "newton"], Field(description="L-BFGS, or Newton with clamped Hessians.")] = (
        "lbfgs"
    )
    linear_solver: Annotated[
        Literal["auto", "direct", "multigrid"],
        Field(description="Of the sparse systems; auto takes a direct factor where it fits in memory."),
    ] = "auto"
    quasistatic: Annotated[bool, Field(description="Leave inertia out: every frame is an equilibrium.")] = False
    factor_cost: Annotated[int, Field(ge=1, description="Cost of a factorisation, in iterations of L-BFGS.")] = 25
    max_iterations: Annotated[int, Field(ge=1, description="Of the minimiser in one step.")] = 500

    def stop(self, vertex_mass: Array) -> float:
        """The tolerance, N, for vertices of so many kg."""
        return within(USUAL, weights(vertex_mass), SHARES_OF_WEIGHTS) if self.tolerance is None else self.tolerance


def weights(vertex_mass: Array) -> float:
    """The norm of the weights of all vertices, N."""
    return EARTH * float(np.linalg.norm(vertex_mass))


def within(usual: float, scale: float, shares: tuple[float, float]) -> float:
    """A tolerance for solids of usual size, which stays between two shares of what acts on this one: on a solid of
    millimetres all forces may be below it, and on one of hundreds of metres it is more than anybody asks for."""
    least, most = shares
    return min(max(usual, least * scale), most * scale)
