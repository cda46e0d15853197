"""Every setting, declared once: type, default, range, unit and a sentence. The only importer of yaml.

The reference page of the docs, `ldsim settings` and the messages about unknown keys all come from these declarations.
"""

from __future__ import annotations

import difflib
import hashlib
import os
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ldsim.errors import SettingsError

Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]

DATA_VARIABLE = "LDSIM_DATA"
DATA_ORIGIN = "its authors publish it in the GitHub repository lawsonfulton/AutoDef"
STAGES = ("mesh", "snapshot", "pca", "train", "cubature", "simulate", "report")


class Section(BaseModel):
    """A part of the configuration; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class MaterialSettings(Section):
    model: Literal["neo_hookean", "stable_neo_hookean", "st_venant_kirchhoff", "fixed_corotated", "linear"] = Field(
        "neo_hookean", description="Elastic energy density."
    )
    youngs_modulus: float = Field(gt=0, description="Young's modulus, Pa.")
    poisson_ratio: float = Field(0.47, gt=-1, lt=0.5, description="Poisson's ratio.")


class ShapeSettings(Section):
    name: str = Field(description="A procedural shape: beam, cross, pendulum, dumbbell.")
    resolution: int = Field(2, ge=1, le=64, description="Cubes across the thinnest side.")
    cell_type: Literal["tet4", "hex8"] = Field("tet4", description="Linear tetrahedra or trilinear hexahedra.")


class SlabSettings(Section):
    axis: Literal["x", "y", "z"] = Field(description="Axis across the slab.")
    at: Literal["min", "max"] = Field("min", description="Which end of the solid.")
    thickness: Positive = Field(description="Vertices within it of the end are pinned, m.")


class BallSettings(Section):
    centre: Vector = Field(description="Centre of the ball, m.")
    radius: Positive = Field(description="Vertices within it of the centre are pinned, m.")


class PinSettings(Section):
    slab: SlabSettings | None = Field(None, description="Pin one end of the solid.")
    ball: BallSettings | None = Field(None, description="Pin what lies in a ball.")

    @model_validator(mode="after")
    def _one(self) -> PinSettings:
        if (self.slab is None) == (self.ball is None):
            raise ValueError("give exactly one of slab, ball")
        return self


class MeshSettings(Section):
    """The scene: all that is physical."""

    file: str | None = Field(None, description="Volume mesh in a format that meshio reads.")
    shape: ShapeSettings | None = Field(None, description="A procedural shape instead of a file.")
    scale: Positive = Field(1.0, description="Factor from the file's unit to metres.")
    reorient: bool = Field(False, description="Flip left-handed cells instead of refusing them.")
    material: MaterialSettings
    density: Positive = Field(1000.0, description="kg/m³.")
    pins: tuple[PinSettings, ...] = Field(min_length=1, description="Vertices that do not move.")
    gravity: Vector = Field((0.0, -9.8, 0.0), description="Acceleration, m/s².")
    time_step: Positive = Field(0.005, description="h, s.")

    @model_validator(mode="after")
    def _one(self) -> MeshSettings:
        if (self.file is None) == (self.shape is None):
            raise ValueError("give exactly one of file, shape")
        return self


class PullSettings(Section):
    count: int = Field(ge=1, description="Number of pulls, one after another.")
    seed: int = Field(0, ge=0, description="Seed of where and which way.")
    reach: Positive = Field(description="How far the pointer goes from the surface, m.")
    stiffness: Positive = Field(30.0, description="Of the spring, N/m.")
    radius: Positive = Field(0.03, description="Vertices within it are held, m.")
    frames: int = Field(40, ge=2, description="Frames of one pull.")
    rest: int = Field(40, ge=0, description="Frames of free motion after each pull.")


class MotionSettings(Section):
    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", description="Name of the motion in every artefact.")
    role: Literal["train", "heldout"] = Field("train", description="Whether the model may learn from it.")
    recording: str | None = Field(None, description="CSV of a recorded interaction.")
    pulls: PullSettings | None = Field(None, description="Seeded random pulls.")
    frames: int | None = Field(None, ge=1, description="Use only the first frames.")

    @model_validator(mode="after")
    def _one(self) -> MotionSettings:
        if (self.recording is None) == (self.pulls is None):
            raise ValueError("give exactly one of recording, pulls")
        return self


class SnapshotSettings(Section):
    """Full-space runs that the model learns from and is judged on."""

    motions: tuple[MotionSettings, ...] = Field(min_length=1, description="What pulls on the solid.")
    tolerance: Positive = Field(1e-6, description="Stop at ‖∇E‖ ≤ tolerance · max(‖u‖, 1), N.")
    factor_cost: int = Field(25, ge=1, description="Cost of a factorisation, in iterations of L-BFGS.")
    max_iterations: int = Field(500, ge=1, description="Of L-BFGS in one step.")
    workers: int = Field(2, ge=1, description="Motions that run side by side.")

    @model_validator(mode="after")
    def _distinct(self) -> SnapshotSettings:
        names = [motion.name for motion in self.motions]
        if len(set(names)) < len(names):
            raise ValueError(f"motions must have different names, got {', '.join(names)}")
        if all(motion.role != "train" for motion in self.motions):
            raise ValueError("at least one motion must have the role train")
        return self


class PcaSettings(Section):
    k: int | None = Field(None, ge=1, description="Dimension; left out, the criterion finds it.")
    criterion: Literal["max_error", "mean_error", "energy"] = Field(
        "max_error", description="What the tolerance is of: vertex error (largest, mean), or energy lost."
    )
    tolerance_mm: Positive = Field(1.0, description="Vertex error over the training snapshots, mm.")
    energy: float = Field(1e-4, gt=0, lt=1, description="Share of the snapshots' squared norm that may be lost.")
    max_k: int = Field(100, ge=1, description="Largest dimension that the criterion may lead to.")
    inner_product: Literal["mass", "euclidean"] = Field("mass", description="In which U is orthonormal.")


class TrainSettings(Section):
    r: int | None = Field(None, ge=1, description="Latent dimension; left out, the smallest that meets the tolerance.")
    tolerance_mm: Positive = Field(6.0, description="Largest vertex error that the search allows, mm.")
    hidden: tuple[Annotated[int, Field(ge=1, le=2000)], ...] = Field(
        (100, 100), min_length=1, description="Widths of the hidden layers of the decoder."
    )
    activation: Literal["elu", "relu", "tanh", "sigmoid"] = Field("elu", description="Of the hidden layers.")
    skip: bool = Field(False, description="A linear skip in the decoder, q = A z + N(z) − N(0).")
    balance: float = Field(
        0.5, ge=0, le=1, description="The loss weights each coordinate by its r.m.s. to −balance; 0 is the paper's."
    )
    equilibrium: float = Field(
        3.0, ge=0, description="Weight of how far forces at decoded poses would move the solid; 0 for none."
    )
    equilibrium_start: float = Field(0.3, ge=0, lt=1, description="Share of the epochs before that loss sets in.")
    equilibrium_poses: int = Field(400, ge=1, description="Training poses that it looks at.")
    noise: float = Field(0.0, ge=0, le=1, description="Denoising: noise on the encoder's input, share of the r.m.s.")
    variational: float = Field(0.0, ge=0, description="Weight of a variational autoencoder's divergence; 0 for none.")
    smoothness: float = Field(0.0, ge=0, description="Weight of the decoder's curvature between poses; 0 for none.")
    epochs: int = Field(2000, ge=1, description="Passes over the training snapshots.")
    batch: int = Field(64, ge=1, description="Snapshots in one gradient.")
    learning_rate: float = Field(2e-3, gt=0, lt=1, description="Of Adam, falling along a cosine.")
    validation_share: float = Field(0.03, gt=0, lt=0.9, description="Share of frames kept back to choose the weights.")
    patience: int = Field(500, ge=1, description="Epochs without a better validation loss before stopping.")
    seed: int = Field(0, ge=0, description="Of weights, split and batches.")
    device: str = Field("auto", pattern=r"^(auto|cpu|cuda(:\d+)?)$", description="auto takes CUDA where there is one.")


class CubatureSettings(Section):
    tolerance: float = Field(0.03, gt=0, lt=1, description="Relative error of the reduced forces on the fitted poses.")
    max_points: int = Field(150, ge=1, description="Most points of the latent set.")
    linear_max_points: int = Field(500, ge=1, description="Most points of the linear set.")
    poses: int = Field(400, ge=1, description="Poses of the training motions to fit.")
    heldout_poses: int = Field(200, ge=1, description="Poses of the training motions kept back from the fit.")
    seed: int = Field(0, ge=0, description="Of the choice of poses.")


class SimulateSettings(Section):
    motions: tuple[str, ...] | None = Field(None, description="Which motions; left out, all.")
    tolerance: Positive = Field(1e-8, description="Stop at ‖∇E‖ ≤ tolerance · max(‖z‖, 1), N.")
    max_iterations: int = Field(200, ge=1, description="Of one reduced step.")
    full_frames: int = Field(100, ge=1, description="Frames of the full space to time, from the first grab on.")
    window: Positive = Field(0.25, description="Restart from the full space this often for the windowed error, s.")


class ReportSettings(Section):
    pictures: int = Field(3, ge=0, le=12, description="Moments to show, full beside linear and latent.")


class Settings(Section):
    """One experiment."""

    experiment: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", description="Name; files lie in runs/<experiment>/.")
    mesh: MeshSettings
    snapshot: SnapshotSettings
    pca: PcaSettings = PcaSettings()  # type: ignore[call-arg]
    train: TrainSettings = TrainSettings()  # type: ignore[call-arg]
    cubature: CubatureSettings = CubatureSettings()  # type: ignore[call-arg]
    simulate: SimulateSettings = SimulateSettings()  # type: ignore[call-arg]
    report: ReportSettings = ReportSettings()  # type: ignore[call-arg]


def load_settings(path: Path) -> Settings:
    """Read and check a configuration.

    Raises:
        SettingsError: the file is missing or not YAML, or a key or value is not allowed; one line names each fault
            with its path, what was got and what is allowed.
    """
    if not path.is_file():
        raise SettingsError(f"configuration {path} does not exist; examples lie in configs/")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise SettingsError(f"configuration {path} is not valid YAML: {reason}") from error
    if content is None:
        raise SettingsError(f"configuration {path} is empty; examples lie in configs/")
    if not isinstance(content, dict):
        raise SettingsError(f"configuration {path} holds {type(content).__name__}; expected a mapping of sections")
    try:
        return Settings.model_validate(content)
    except ValidationError as error:
        faults = "; ".join(_fault(dict(fault)) for fault in error.errors())
        raise SettingsError(f"configuration {path}: {faults}") from error


def _fault(fault: dict[str, Any]) -> str:
    """One fault in words: the key's path, what is wrong, what was got, and the nearest known key."""
    where = ".".join(str(part) for part in fault["loc"]) or "configuration"
    if fault["type"] == "extra_forbidden":
        known = _known_keys(fault["loc"][:-1])
        near = difflib.get_close_matches(str(fault["loc"][-1]), known, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(sorted(known))}"
        return f"unknown key {where!r}; {hint}"
    if fault["type"] == "missing":
        return f"{where} is missing"
    got = "" if isinstance(fault["input"], dict | list) else f", got {fault['input']!r}"
    message = fault["msg"].removeprefix("Value error, ")
    return f"{where}: {message[:1].lower()}{message[1:]}{got}"


def _known_keys(location: tuple[int | str, ...]) -> list[str]:
    """The keys of the section at a path; union members and list indices are passed through."""
    sections: list[type[BaseModel]] = [Settings]
    for part in location:
        if isinstance(part, int):
            continue
        fields = [section.model_fields[part] for section in sections if part in section.model_fields]
        sections = [inner for field in fields for inner in _sections_in(field.annotation)]
    return [key for section in sections for key in section.model_fields]


def _sections_in(annotation: object) -> list[type[BaseModel]]:
    """The sections named anywhere in a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [section for inner in getattr(annotation, "__args__", ()) for section in _sections_in(inner)]


def dump(section: BaseModel) -> str:
    """A section with its defaults as YAML, the same text for the same values."""
    text: str = yaml.safe_dump(section.model_dump(mode="json"), sort_keys=False, allow_unicode=True, width=120)
    return text


def stage_settings(settings: Settings, stage: str) -> Section:
    """The section of a stage."""
    section: Section = getattr(settings, stage)
    return section


def resolve_path(text: str, config: Path) -> Path:
    """A path of a configuration: $LDSIM_DATA expanded, relative to the folder of the configuration.

    Raises:
        SettingsError: LDSIM_DATA is used but not set, or the file is not there.
    """
    from_data = DATA_VARIABLE in text
    if from_data:
        root = os.environ.get(DATA_VARIABLE, "")
        if not root:
            raise SettingsError(
                f"{text} needs the environment variable {DATA_VARIABLE}: the folder that holds the paper's meshes/ and "
                f"interactions/; {DATA_ORIGIN}"
            )
        root = str(Path(root).resolve())
        text = text.replace("${" + DATA_VARIABLE + "}", root).replace("$" + DATA_VARIABLE, root)
    path = config.parent / Path(text).expanduser()
    if not path.exists():
        hint = f"; {DATA_VARIABLE} says where the paper's data lie, {DATA_ORIGIN}" if from_data else ""
        raise SettingsError(f"{path} does not exist{hint}")
    return path


def input_files(settings: Settings, stage: str, config: Path) -> list[Path]:
    """The files outside the run that a stage reads."""
    if stage == "mesh" and settings.mesh.file is not None:
        return [resolve_path(settings.mesh.file, config)]
    if stage == "snapshot":
        names = [motion.recording for motion in settings.snapshot.motions if motion.recording is not None]
        return [resolve_path(name, config) for name in names]
    return []


def stamp(settings: Settings, stage: str, config: Path) -> str:
    """What a stage depends on besides artefacts: its settings and the hashes of its input files, as text."""
    lines = [dump(stage_settings(settings, stage))]
    for path in input_files(settings, stage, config):
        lines.append(f"# {path.name}: {hashlib.sha256(path.read_bytes()).hexdigest()}\n")
    return "".join(lines)
