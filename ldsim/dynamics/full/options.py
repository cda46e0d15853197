"""The options of the full-space solver."""

from __future__ import annotations

from typing import Annotated, Literal

from ldsim.options import Field, Options


class FullOptions(Options):
    """How a step of the full space is solved."""

    tolerance: Annotated[float, Field(gt=0, description="Stop at ‖∇E‖ ≤ tolerance · max(‖u‖, 1), N.")] = 1e-6
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
