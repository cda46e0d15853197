"""The options of the full-space solver."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from ldsim.arrays import Array
from ldsim.mechanics.options import EARTH
from ldsim.options import Field, Options

# Where no tolerance is given: N, and the largest share of the norm of the weights of all vertices.
USUAL, SHARE_OF_WEIGHTS = 1e-6, 1e-2


class FullOptions(Options):
    """How a step of the full space is solved."""

    tolerance: Annotated[
        float | None,
        Field(
            gt=0,
            description="Stop at ‖∇E‖ ≤ tolerance · max(‖u‖, 1), N; left out, 10⁻⁶ and at most 1 % of the norm of the "
            "weights of the vertices.",
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
        """The tolerance, N, for vertices of so many kg: all forces on a solid of millimetres may be below 10⁻⁶ N."""
        usual = min(USUAL, SHARE_OF_WEIGHTS * EARTH * float(np.linalg.norm(vertex_mass)))
        return usual if self.tolerance is None else self.tolerance
