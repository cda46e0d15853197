"""The options of a linear basis."""

from __future__ import annotations

from typing import Annotated, Literal

from ldsim.mechanics.options import PullOptions
from ldsim.options import Field, Options, Positive, model_validator

# Where neither their number nor a criterion is given; a condensed space takes its coordinates from the first of them.
COLUMNS = 40
CRITERIA = "max_error, mean_error or energy"


class PcaOptions(Options):
    """How many modes: k where it is given, or the fewest that meet a tolerance on the training snapshots."""

    k: Annotated[
        int | None,
        Field(ge=1, description="Dimension; left out, the criterion finds it, and without one 40 are taken."),
    ] = None
    criterion: Annotated[
        Literal["max_error", "mean_error", "energy"] | None,
        Field(description="What a tolerance is of: vertex error (largest, mean), or energy lost."),
    ] = None
    tolerance_mm: Annotated[Positive, Field(description="Vertex error over the training snapshots, mm.")] = 1.0
    energy: Annotated[
        float, Field(gt=0, lt=1, description="Share of the snapshots' squared norm that may be lost.")
    ] = 1e-4
    max_k: Annotated[int, Field(ge=1, description="Largest dimension that the criterion may lead to.")] = 100
    synthetic: Annotated[
        PullOptions | None,
        Field(
            description="Random pulls, run in the linear space of all k columns: they turn the basis, and the latent "
            "space learns from them too. Left out, none; where k and criterion are left out too, 40 like those of the "
            "training motions of a mesh of more than 10,000 vertices."
        ),
    ] = None
    inner_product: Annotated[Literal["mass", "euclidean"], Field(description="In which U is orthonormal.")] = "mass"

    @model_validator(mode="after")
    def _a_tolerance_is_of_a_criterion(self) -> PcaOptions:
        if self.criterion is None and self.k is None:
            for name in ("tolerance_mm", "energy", "max_k"):
                if getattr(self, name) != type(self).model_fields[name].default:
                    raise ValueError(f"{name} is of a criterion; give criterion too, {CRITERIA}")
        return self

    @property
    def is_open(self) -> bool:
        """Whether its size and the synthetic pulls are left to what the solid asks for."""
        return self.k is None and self.criterion is None and self.synthetic is None

    @property
    def columns(self) -> int | None:
        """As many as are asked for; None where the criterion finds how many."""
        return self.k or (COLUMNS if self.criterion is None else None)

    @property
    def tolerance(self) -> float:
        """Of the criterion: metres, or the share of the energy."""
        return self.energy if self.criterion == "energy" else self.tolerance_mm / 1e3

    def describe(self, reached: float) -> str:
        """What was reached and what is allowed, in words."""
        if self.criterion == "energy":
            return f"lose {reached:.3g} of the energy, allowed are {self.energy:.3g}; raise pca.max_k or pca.energy"
        kind = "vertex error" if self.criterion == "max_error" else "mean vertex error"
        return (
            f"leave a {kind} of {1e3 * reached:.3g} mm, allowed are {self.tolerance_mm:.3g} mm; raise pca.max_k or "
            "pca.tolerance_mm"
        )
