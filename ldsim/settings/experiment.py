"""The sections of the stages, and the experiment that they make up."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ldsim.learn.options import TrainOptions
from ldsim.options import Options, Positive, checked_options, read_options
from ldsim.pipeline.options import MeshOptions, SimulateOptions, SnapshotOptions
from ldsim.report.options import ReportOptions
from ldsim.space.options import PcaOptions

STAGES = ("mesh", "snapshot", "pca", "train", "cubature", "simulate", "report")


class VirtualSettings(Options):
    points: int = Field(24, ge=0, description="Most virtual points of the latent set; 0 for none.")
    linear_points: int = Field(0, ge=0, description="The same for the linear set.")
    poses: int = Field(5000, ge=2, description="Most poses to fit; half recorded ones where others are synthetic.")
    closures: tuple[Annotated[float, Field(ge=0, le=1)], ...] = Field(
        (0.0, 1.0), min_length=1, description="Shares of the true poses' forces to aim at; the best online is kept."
    )
    steps: int = Field(5000, ge=1, description="Of Adam.")
    batch: int = Field(256, ge=1, description="States in one gradient.")
    rate: float = Field(3e-3, gt=0, lt=1, description="Largest step, in root mean squares of the strain maps' columns.")


class CubatureSettings(Options):
    method: Literal["exchange", "ecsw", "an", "nn_htp", "uniform"] = Field(
        "exchange", description="How the points are found (docs/guide/cubature.md)."
    )
    project: Literal["latent", "linear"] = Field(
        "latent", description="Forces of the latent set: through the decoder's Jacobian, or in the space of U."
    )
    norm: Literal["compliance", "force"] = Field(
        "compliance", description="Forces measured by the displacement energy they cause at rest, or by their size."
    )
    tolerance: float = Field(0.035, gt=0, lt=1, description="Relative error of the reduced forces on the fitted poses.")
    max_points: int = Field(150, ge=1, description="Most points of the latent set.")
    linear_max_points: int = Field(500, ge=1, description="Most points of the linear set.")
    poses: int = Field(400, ge=1, description="Poses of the training motions to fit.")
    heldout_poses: int = Field(200, ge=1, description="Poses of the training motions kept back from the fit.")
    perturbed: float = Field(0.0, ge=0, le=1, description="Perturbed states fitted too, as a share of the poses.")
    perturbation: Positive = Field(0.1, description="Their distance from poses, in standard deviations of the poses.")
    tangent: float = Field(0.0, ge=0, description="Weight of the tangent stiffness in the fit; 0 leaves it out.")
    energy: float = Field(0.0, ge=0, description="Weight of the energy in the fit; 0 leaves it out.")
    closure: float = Field(0.0, ge=0, le=1, description="Share of the true poses' forces in the latent set's target.")
    volume: float = Field(0.3, ge=0, description="Weight of the total volume in the fit; 0 leaves it out.")
    virtual: VirtualSettings = VirtualSettings()  # type: ignore[call-arg]
    candidates: int = Field(50_000, ge=1, description="Most points looked at, drawn at random where there are more.")
    threads: int = Field(0, ge=0, description="That share out the poses; 0 for one a core. The result is the same.")
    seed: int = Field(0, ge=0, description="Of the choice of poses and candidates.")


class Settings(Options):
    """One experiment."""

    experiment: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", description="Name; files lie in runs/<experiment>/.")
    mesh: MeshOptions
    snapshot: SnapshotOptions
    pca: PcaOptions = PcaOptions()
    train: TrainOptions = TrainOptions()
    cubature: CubatureSettings = CubatureSettings()  # type: ignore[call-arg]
    simulate: SimulateOptions = SimulateOptions()
    report: ReportOptions = ReportOptions()

    @model_validator(mode="after")
    def _synthetic_motions_have_inertia(self) -> Settings:
        if self.snapshot.quasistatic and self.train.synthetic is not None:
            raise ValueError("train.synthetic steps with inertia, snapshot.quasistatic leaves it out; drop one")
        return self

    def section(self, stage: str) -> Options:
        """The options of a stage."""
        section: Options = getattr(self, stage)
        return section


def load_settings(path: Path) -> Settings:
    """Read and check a configuration; see `read_options`."""
    return read_options(path, "configuration", Settings)


def settings_of(content: Mapping[str, Any], source: str) -> Settings:
    """Check a configuration that was made, not read; `source` names it in messages."""
    return checked_options(content, f"configuration {source}", Settings)
