"""What can be said to the choice of cubature rules, declared once: the section `cubature` of a configuration."""

from __future__ import annotations

from typing import Annotated, Literal

from ldsim.errors import SettingsError
from ldsim.options import Field, Options, Positive, Seed

# The sizes of the linear space lie about this factor apart.
ROOT = 2**0.5
# A tolerance that no rule meets.
NEVER = 1e-12

Share = Annotated[float, Field(ge=0, le=1)]


class TermOptions(Options):
    """What a fit takes in besides the forces of the decoded poses; 0 leaves it out."""

    volume: Annotated[float, Field(ge=0, description="Weight of the total volume, relative to the forces.")] = 0.3
    closure: Annotated[Share, Field(description="Share of the true poses' forces in the target.")] = 0.0


class FitOptions(Options):
    """How a rule is fitted to the forces of some poses."""

    method: Annotated[
        Literal["exchange", "ecsw", "an", "nn_htp", "uniform"],
        Field(description="How the points are found (docs/guide/cubature.md)."),
    ] = "exchange"
    project: Annotated[
        Literal["latent", "linear"],
        Field(description="Forces of the latent rule: through the decoder's Jacobian, or in the space of U."),
    ] = "latent"
    norm: Annotated[
        Literal["compliance", "force"],
        Field(description="Forces measured by the displacement energy they cause at rest, or by their size."),
    ] = "compliance"
    tolerance: Annotated[
        float,
        Field(gt=0, lt=1, description="Relative error of the reduced forces, on fitted poses and those kept back."),
    ] = 0.035
    max_points: Annotated[int, Field(ge=1, description="Most points of the latent rule.")] = 150
    terms: TermOptions = TermOptions()
    perturbation: Annotated[
        Positive, Field(description="Distance of perturbed states from poses, in standard deviations of the poses.")
    ] = 0.1
    candidates: Annotated[
        int, Field(ge=1, description="Most points looked at, drawn at random where there are more.")
    ] = 50_000
    seed: Annotated[Seed, Field(description="Of the choice of poses and candidates.")] = 0


class VirtualOptions(Options):
    """How virtual points are fitted: points with strain maps of their own."""

    points: Annotated[
        int,
        Field(ge=0, description="Most of a rule; 0 for none. A condensed space has those of train.condensed.points."),
    ] = 24
    linear_points: Annotated[
        int | None, Field(ge=0, description="The same for the linear rules alone; left out, as virtual.points says.")
    ] = None
    poses: Annotated[
        int, Field(ge=2, description="Most poses to fit; half recorded ones where there are synthetic ones too.")
    ] = 5000
    closures: Annotated[
        tuple[Share, ...],
        Field(
            min_length=1,
            description="Shares of the true poses' forces to fit to; the largest of those about best online.",
        ),
    ] = (0.0, 1.0)
    steps: Annotated[int, Field(ge=1, description="Of Adam.")] = 5000
    batch: Annotated[int, Field(ge=1, description="States in one gradient.")] = 256
    rate: Annotated[
        float, Field(gt=0, lt=1, description="Largest step, in root mean squares of the strain maps' columns.")
    ] = 3e-3


class CubatureOptions(FitOptions):
    """The choice of the rules of the latent space, of whatever kind, and of the linear ones beside it."""

    linear_max_points: Annotated[int, Field(ge=1, description="Most points of a linear rule.")] = 500
    linear_sizes: Annotated[
        tuple[Annotated[int, Field(ge=1)], ...] | None,
        Field(description="Dimensions of the linear space besides kp; left out, some below and above it."),
    ] = None
    equal_points: Annotated[
        bool,
        Field(description="Give the linear spaces as many points as the latent one has (paper, Table 1)."),
    ] = False
    poses: Annotated[int, Field(ge=1, description="Most poses of the training motions to fit.")] = 200
    heldout_poses: Annotated[
        int, Field(ge=1, description="Most poses of the training motions kept back from the fit.")
    ] = 50
    virtual: VirtualOptions = VirtualOptions()
    threads: Annotated[
        int, Field(ge=0, description="That share out the poses; 0 for one a core. The result is the same.")
    ] = 0

    def linear(self, points: int | None = None) -> CubatureOptions:
        """The same for the linear space, with its own sizes.

        Args:
            points: just so many, whatever their error.
        """
        virtual = self.virtual
        if virtual.linear_points is not None:
            virtual = virtual.replace(points=virtual.linear_points)
        if points is not None:
            return self.replace(max_points=points, tolerance=NEVER, virtual=virtual)
        return self.replace(max_points=self.linear_max_points, virtual=virtual)

    def sizes(self, kp: int, k: int) -> tuple[int, ...]:
        """The dimensions of the linear space that are fitted, falling, without kp.

        Args:
            k: columns of the basis.

        Raises:
            SettingsError: one that is asked for is larger.
        """
        wanted = {round(kp / ROOT), k} | ({round(k / 2)} if kp == k else set())
        if k > ROOT * kp:
            wanted.add(round((kp * k) ** 0.5))
        if self.linear_sizes is not None:
            wanted = set(self.linear_sizes)
        if max(wanted, default=0) > k:
            raise SettingsError(f"cubature.linear_sizes has {max(wanted)}; the basis has {k} columns (pca.k)")
        return tuple(sorted(wanted - {kp, 0}, reverse=True))
