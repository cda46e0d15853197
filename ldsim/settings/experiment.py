"""The sections of the stages, and the experiment that they make up."""

from __future__ import annotations

import random
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ldsim.dynamics.full.options import FullOptions
from ldsim.learn.options import TrainOptions
from ldsim.options import Options, Positive
from ldsim.settings.motions import MotionSettings
from ldsim.settings.scene import MaterialChangeSettings, MeshSettings

STAGES = ("mesh", "snapshot", "pca", "train", "cubature", "simulate", "report")


class SnapshotSettings(FullOptions):
    """Full-space runs that the model learns from and is judged on."""

    motions: tuple[MotionSettings, ...] = Field(min_length=1, description="What happens to the solid.")
    heldout_share: float = Field(
        0.0, ge=0, lt=1, description="Share of the motions without a role to hold out, at least one if above 0."
    )
    heldout_seed: int = Field(0, ge=0, description="Of the choice of these.")
    workers: int = Field(2, ge=1, description="Motions that run side by side.")

    @model_validator(mode="after")
    def _distinct(self) -> SnapshotSettings:
        names = [motion.name for motion in self.motions]
        if len(set(names)) < len(names):
            raise ValueError(f"motions must have different names, got {', '.join(names)}")
        if "train" not in self.roles:
            raise ValueError("at least one motion must have the role train")
        return self

    @property
    def roles(self) -> tuple[str, ...]:
        """The role of each motion, given or chosen."""
        open_ = [i for i, motion in enumerate(self.motions) if motion.role is None]
        count = max(round(self.heldout_share * len(open_)), 1) if self.heldout_share > 0 and open_ else 0
        chosen = random.Random(self.heldout_seed).sample(open_, count)
        return tuple(motion.role or ("heldout" if i in chosen else "train") for i, motion in enumerate(self.motions))


class PcaSettings(Options):
    k: int | None = Field(None, ge=1, description="Dimension; left out, the criterion finds it.")
    criterion: Literal["max_error", "mean_error", "energy"] = Field(
        "max_error", description="What the tolerance is of: vertex error (largest, mean), or energy lost."
    )
    tolerance_mm: Positive = Field(1.0, description="Vertex error over the training snapshots, mm.")
    energy: float = Field(1e-4, gt=0, lt=1, description="Share of the snapshots' squared norm that may be lost.")
    max_k: int = Field(100, ge=1, description="Largest dimension that the criterion may lead to.")
    inner_product: Literal["mass", "euclidean"] = Field("mass", description="In which U is orthonormal.")


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


class SimulateSettings(Options):
    motions: tuple[str, ...] | None = Field(None, description="Which motions; left out, all.")
    points: int | None = Field(None, ge=1, description="The largest latent set of at most so many; left out, the best.")
    linear_points: int | None = Field(None, ge=1, description="The same for the linear set.")
    tolerance: Positive = Field(1e-8, description="Stop at ‖∇E‖ ≤ tolerance · max(‖z‖, 1), N.")
    max_iterations: int = Field(200, ge=1, description="Of one reduced step.")
    full_frames: int = Field(100, ge=1, description="Frames of the full space to time, from the first grab on.")
    material: MaterialChangeSettings | None = Field(
        None, description="Another material than that of the scene, for all motions; no errors are computed then."
    )
    window: Positive = Field(0.25, description="Restart from the full space this often for the windowed error, s.")


class ReportSettings(Options):
    pictures: int = Field(3, ge=0, le=12, description="Moments to show, full beside linear and latent.")


class Settings(Options):
    """One experiment."""

    experiment: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", description="Name; files lie in runs/<experiment>/.")
    mesh: MeshSettings
    snapshot: SnapshotSettings
    pca: PcaSettings = PcaSettings()  # type: ignore[call-arg]
    train: TrainOptions = TrainOptions()
    cubature: CubatureSettings = CubatureSettings()  # type: ignore[call-arg]
    simulate: SimulateSettings = SimulateSettings()  # type: ignore[call-arg]
    report: ReportSettings = ReportSettings()  # type: ignore[call-arg]

    @model_validator(mode="after")
    def _synthetic_motions_have_inertia(self) -> Settings:
        if self.snapshot.quasistatic and self.train.synthetic is not None:
            raise ValueError("train.synthetic steps with inertia, snapshot.quasistatic leaves it out; drop one")
        return self
