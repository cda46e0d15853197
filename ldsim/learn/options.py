"""The options of the stage train: the network, what it learns from, the terms of its loss, and the search for r."""

from __future__ import annotations

from typing import Annotated, Literal

from ldsim.options import Field, Options, Positive, Seed

Activation = Literal["elu", "relu", "tanh", "sigmoid"]

# What a condensed space has no use for; an autoencoder has none for the section `condensed`.
OF_AUTOENCODER = (
    "tolerance_mm",
    "balance",
    "equilibrium",
    "variational",
    "denoising",
    "recorded_share",
    "epochs",
    "batch",
    "optimiser",
    "schedule",
    "learning_rate",
    "validation_share",
    "patience",
    "device",
)

Width = Annotated[int, Field(ge=1, le=2000)]

# Of hidden layers that were left out. A condensed space of a mesh of more vertices than this has the wider ones, which
# cost little where frames and poses cost much (docs/notebook/2026-11-25-on_demand.md).
ACTIVATIONS: dict[str, Activation] = {"autoencoder": "elu", "condensed": "tanh"}
LAYERS = {"autoencoder": (100, 100), "condensed": (48, 48, 48, 48)}
MANY, WIDER = 10_000, (80, 80, 80, 80)
# Poses of training motions that are relaxed, and of each round of own runs: so many, or up to twice as many of a solid
# of fewer unknowns, for there a pose costs less than what is fitted to it.
POSES, EXPLORED, UNKNOWNS = 200, 150, 9000


class LossTerm(Options):
    """A term of the loss beside the reconstruction error."""

    weight: Annotated[Positive, Field(description="Of the term; the reconstruction error has 1.")]


class EquilibriumTerm(LossTerm):
    """How far the forces at decoded poses would move a solid that is at rest at the true ones."""

    start: Annotated[float, Field(ge=0, lt=1, description="Share of the epochs before it sets in.")] = 0.3
    poses: Annotated[int, Field(ge=1, description="Training poses that it looks at.")] = 200


class Denoising(Options):
    """Noise on what the encoder sees (Vincent et al. 2008)."""

    noise: Annotated[float, Field(gt=0, le=1, description="Standard deviation, as a share of a coordinate's r.m.s.")]


class CondensedOptions(Options):
    """A condensed latent space: what is relaxed, and what is fitted to it."""

    poses: Annotated[
        int | None,
        Field(ge=1, description="Training poses that are relaxed; left out, 200, or up to 400 of a small solid."),
    ] = None
    shell: Annotated[int, Field(ge=0, description="Perturbed poses around each that are relaxed too.")] = 1
    rounds: Annotated[
        int, Field(ge=0, description="How often the model is run under other loads, and learns from where it went.")
    ] = 2
    explored: Annotated[
        int | None,
        Field(ge=1, description="Poses of its own runs that are relaxed in each round; left out, 150, or up to 300."),
    ] = None
    points: Annotated[int, Field(ge=1, description="Virtual points of the potential V_eff.")] = 24
    features: Annotated[int, Field(ge=0, description="Learned functions of z that they see beside z.")] = 24
    columns: Annotated[int, Field(ge=1, description="Most modes of what is slaved to z beside rest's tangents.")] = 80
    steps: Annotated[int, Field(ge=1, description="Gradients of the fit.")] = 8000
    modes: Annotated[
        int, Field(ge=0, description="Slowest modes beside z, which may swing: where motions are a tenth less off.")
    ] = 48

    def relaxed(self, unknowns: int) -> tuple[int, int]:
        """How many poses of the training motions are relaxed, and of each round of own runs.

        Args:
            unknowns: of the solid, 3 for each free vertex.
        """
        times = min(max(UNKNOWNS / unknowns, 1.0), 2.0)
        return self.poses or round(POSES * times), self.explored or round(EXPLORED * times)


class TrainOptions(Options):
    """Training of the latent space: an autoencoder in PCA coordinates (paper, Sec. 4), or a condensed space."""

    kind: Annotated[
        Literal["autoencoder", "condensed"],
        Field(description="condensed: all but r coordinates in static equilibrium (docs/guide/theory.md)."),
    ] = "condensed"
    condensed: Annotated[CondensedOptions, Field(description="Of a condensed space.")] = CondensedOptions()

    r: Annotated[
        int | None,
        Field(
            ge=1,
            description="Latent dimension; left out, the fewest that hold the training motions, or the best tried.",
        ),
    ] = None
    tolerance_mm: Annotated[
        Positive, Field(description="Largest vertex error that the search of an autoencoder allows, mm.")
    ] = 6.0
    hidden: Annotated[
        tuple[Width, ...] | None,
        Field(
            min_length=1,
            description="Widths of the decoder's hidden layers; left out, [100, 100] of an autoencoder, of a condensed "
            "space four of 48, or of 80 of more than 10,000 vertices.",
        ),
    ] = None
    activation: Annotated[
        Activation | None,
        Field(description="Of the hidden layers; left out, elu of an autoencoder, tanh of a condensed space."),
    ] = None
    # Small coordinates are stiff ones, and forces hang on them: with all errors alike they are learned last.
    balance: Annotated[
        float,
        Field(ge=0, le=1, description="The loss weights each coordinate by its r.m.s. to −balance; 0 is the paper's."),
    ] = 0.5
    equilibrium: Annotated[EquilibriumTerm | None, Field(description="Loss of forces; left out, none.")] = None
    variational: Annotated[
        LossTerm | None, Field(description="Divergence of a variational autoencoder (Kingma and Welling 2014).")
    ] = None
    denoising: Annotated[Denoising | None, Field(description="Noise on the encoder's input; left out, none.")] = None
    recorded_share: Annotated[
        float, Field(ge=0, le=0.9, description="Least share of recorded frames in an epoch; they are repeated for it.")
    ] = 0.5
    epochs: Annotated[int, Field(ge=1, description="Passes over the training snapshots.")] = 400
    batch: Annotated[int, Field(ge=1, description="Snapshots in one gradient.")] = 256
    optimiser: Annotated[
        Literal["soap", "adam"], Field(description="SOAP (docs/guide/reduced_space.md), or the paper's Adam.")
    ] = "soap"
    schedule: Annotated[
        Literal["cosine", "fixed"], Field(description="The rate falls along a cosine, or is the paper's fixed one.")
    ] = "cosine"
    learning_rate: Annotated[
        float, Field(gt=0, lt=1, description="Of the optimiser, at first; the paper's is 0.001.")
    ] = 1e-2
    validation_share: Annotated[
        float, Field(gt=0, lt=0.9, description="Share of frames kept back to choose the weights.")
    ] = 0.03
    # The rate falls to a thousandth until the last epoch, and much of the gain comes late: stop early only for haste.
    patience: Annotated[
        int | None,
        Field(ge=1, description="Stop after so many epochs without a better validation loss; left out, never."),
    ] = None
    seed: Annotated[Seed, Field(description="Of weights, split and batches.")] = 0
    device: Annotated[
        str, Field(pattern=r"^(auto|cpu|cuda(:\d+)?)$", description="Of an autoencoder; auto takes CUDA where it is.")
    ] = "auto"

    @property
    def layers(self) -> tuple[int, ...]:
        """Widths of the hidden layers of the decoder; those of a mesh that is not large where they were left out."""
        return LAYERS[self.kind] if self.hidden is None else self.hidden

    @property
    def nonlinearity(self) -> Activation:
        """Of the hidden layers."""
        return self.activation or ACTIVATIONS[self.kind]

    def of_solid(self, vertices: int, unknowns: int) -> TrainOptions:
        """The same with what was left out, as it follows from the kind and from the solid.

        Args:
            vertices: of its mesh.
            unknowns: 3 for each vertex that is free.
        """
        if self.kind == "autoencoder":
            return self.replace(hidden=self.layers, activation=self.nonlinearity)
        hidden = self.hidden or (WIDER if vertices > MANY else self.layers)
        poses, explored = self.condensed.relaxed(unknowns)
        condensed = self.condensed.replace(poses=poses, explored=explored)
        return self.replace(hidden=hidden, activation=self.nonlinearity, condensed=condensed)

    def without_effect(self) -> str:
        """That what was given says nothing to this kind, in a line; empty where all has an effect, or is a default."""
        fields, unread = type(self).model_fields, OF_AUTOENCODER if self.kind == "condensed" else ("condensed",)
        given = [name for name in fields if name in unread and getattr(self, name) != fields[name].default]
        names, have = ", ".join(f"train.{name}" for name in given), "has" if len(given) == 1 else "have"
        return f"note: {names} {have} no effect: train.kind is {self.kind}" if given else ""
