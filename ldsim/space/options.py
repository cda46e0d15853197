"""The options of a linear basis."""

from __future__ import annotations

from typing import Annotated, Literal

from ldsim.mechanics.options import PullOptions
from ldsim.options import Field, Options, Positive


class PcaOptions(Options):
    """How many modes: k where it is given, else the fewest that meet a tolerance on the training snapshots."""

    k: Annotated[int | None, Field(ge=1, description="Dimension; left out, the criterion finds it.")] = None
    criterion: Annotated[
        Literal["max_error", "mean_error", "energy"],
        Field(description="What the tolerance is of: vertex error (largest, mean), or energy lost."),
    ] = "max_error"
    tolerance_mm: Annotated[Positive, Field(description="Vertex error over the training snapshots, mm.")] = 1.0
    energy: Annotated[
        float, Field(gt=0, lt=1, description="Share of the snapshots' squared norm that may be lost.")
    ] = 1e-4
    max_k: Annotated[int, Field(ge=1, description="Largest dimension that the criterion may lead to.")] = 100
    synthetic: Annotated[
        PullOptions | None,
        Field(
            description="Random pulls, run in the linear space of all k columns: they turn the basis, and the latent "
            "space learns from them too."
        ),
    ] = None
    inner_product: Annotated[Literal["mass", "euclidean"], Field(description="In which U is orthonormal.")] = "mass"

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
