"""Every setting, declared once: type, default, range, unit and a sentence. The only importer of yaml.

The reference page of the docs, `ldsim settings` and the messages about unknown keys all come from these declarations.
"""

from __future__ import annotations

import difflib
import hashlib
import itertools
import os
import random
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from ldsim.errors import SettingsError

Vector = tuple[float, float, float]
MaterialName = Literal["neo_hookean", "stable_neo_hookean", "st_venant_kirchhoff", "fixed_corotated", "linear"]
Positive = Annotated[float, Field(gt=0)]

DATA_VARIABLE = "LDSIM_DATA"
DATA_ORIGIN = "its authors publish it in the GitHub repository lawsonfulton/AutoDef"
MOTION_KINDS = ("recording", "pulls", "script", "script_file", "gravity_sweep", "release")
STAGES = ("mesh", "snapshot", "pca", "train", "cubature", "simulate", "report")


class Section(BaseModel):
    """A part of the configuration; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class MaterialSettings(Section):
    model: MaterialName = Field("neo_hookean", description="Elastic energy density.")
    youngs_modulus: float = Field(gt=0, description="Young's modulus, Pa.")
    poisson_ratio: float = Field(0.47, gt=-1, lt=0.5, description="Poisson's ratio.")


class ShapeSettings(Section):
    name: str = Field(
        description="A procedural shape: beam, mounted_bar, cross, slender_cross, catapult, pendulum, dumbbell."
    )
    resolution: int = Field(2, ge=1, le=64, description="Cubes across the thinnest side.")
    cell_type: Literal["tet4", "hex8"] = Field("tet4", description="Linear tetrahedra or trilinear hexahedra.")


class SurfaceSettings(Section):
    """A closed triangle surface, filled with tets."""

    file: str = Field(description="Triangle surface: .stl, .obj, .ply, .off and others.")
    edge_length: Positive | None = Field(None, description="Edges of the tets, about, m.")
    cells: int | None = Field(None, ge=10, description="Number of tets instead, about; takes up to five tries.")
    envelope: Positive | None = Field(
        None, description="How far the tets may be from the surface, m; left out, a twentieth of the edge length."
    )
    timeout: float = Field(600.0, ge=1, description="Longest that one try may take, s.")

    @model_validator(mode="after")
    def _one(self) -> SurfaceSettings:
        if (self.edge_length is None) == (self.cells is None):
            raise ValueError("give exactly one of edge_length, cells")
        return self


class SlabSettings(Section):
    axis: Literal["x", "y", "z"] = Field(description="Axis across the slab.")
    at: Literal["min", "max"] = Field("min", description="Which end of the solid.")
    thickness: Positive = Field(description="Vertices within it of the end are pinned, m.")


class BallSettings(Section):
    centre: Vector = Field(description="Centre of the ball, m.")
    radius: Positive = Field(description="Vertices within it of the centre are pinned, m.")


class BoxSettings(Section):
    min: Vector = Field(description="Its corner of smallest coordinates, m.")
    max: Vector = Field(description="Its corner of largest coordinates, m.")

    @model_validator(mode="after")
    def _ordered(self) -> BoxSettings:
        if any(low > high for low, high in zip(self.min, self.max, strict=True)):
            raise ValueError(f"min {list(self.min)} must not be greater than max {list(self.max)} on any axis")
        return self


class RegionSettings(Section):
    """A part of the solid at rest."""

    slab: SlabSettings | None = Field(None, description="One end of the solid.")
    ball: BallSettings | None = Field(None, description="What lies in a ball.")
    box: BoxSettings | None = Field(None, description="What lies in a box with edges along the axes.")
    vertices: tuple[Annotated[int, Field(ge=0)], ...] | None = Field(
        None, min_length=1, description="These vertices, numbered from 0 as in scene.h5."
    )
    group: str | None = Field(None, description="A group of the mesh file; `ldsim info` of scene.h5 lists them.")

    @model_validator(mode="after")
    def _one(self) -> RegionSettings:
        if sum(getattr(self, name) is not None for name in RegionSettings.model_fields) != 1:
            raise ValueError(f"give exactly one of {', '.join(RegionSettings.model_fields)}")
        return self


class MaterialChangeSettings(Section):
    """What is different from the material so far; what is left out stays."""

    model: MaterialName | None = Field(None, description="Elastic energy density.")
    youngs_modulus: Positive | None = Field(None, description="Young's modulus, Pa.")
    youngs_factor: Positive = Field(1.0, description="Factor on Young's modulus.")
    poisson_ratio: float | None = Field(None, gt=-1, lt=0.5, description="Poisson's ratio.")


class MaterialRegionSettings(Section):
    where: RegionSettings = Field(description="Cells whose centroid lies in it, or that its list or group holds.")
    material: MaterialChangeSettings = MaterialChangeSettings()  # type: ignore[call-arg]
    density: Positive | None = Field(None, description="kg/m³.")


class CellDataSettings(Section):
    """Names of numbers that the mesh file gives to each cell."""

    youngs_modulus: str | None = Field(None, description="Young's modulus, Pa.")
    poisson_ratio: str | None = Field(None, description="Poisson's ratio.")
    density: str | None = Field(None, description="kg/m³.")


class LoadSettings(Section):
    """A force on a region that keeps its size and direction however the solid deforms."""

    where: RegionSettings = Field(description="Its cells, or the faces of the surface whose vertices all lie in it.")
    acceleration: Vector | None = Field(None, description="Of the cells, as gravity acts, m/s².")
    traction: Vector | None = Field(None, description="On the surface, force per area at rest, Pa.")
    pressure: float | None = Field(None, description="Against the surface at rest, Pa.")

    @model_validator(mode="after")
    def _one(self) -> LoadSettings:
        if sum(load is not None for load in (self.acceleration, self.traction, self.pressure)) != 1:
            raise ValueError("give exactly one of acceleration, traction, pressure")
        return self


class MeshSettings(Section):
    """The scene: all that is physical."""

    file: str | None = Field(None, description="Volume mesh in a format that meshio reads.")
    shape: ShapeSettings | None = Field(None, description="A procedural shape instead of a file.")
    surface: SurfaceSettings | None = Field(None, description="A closed triangle surface instead, filled with tets.")
    scale: Positive = Field(1.0, description="Factor from the file's unit to metres.")
    refine: int = Field(0, ge=0, le=4, description="Cut every tet into eight, this many times.")
    reorient: bool = Field(False, description="Flip left-handed cells instead of refusing them.")
    material: MaterialSettings
    density: Positive = Field(1000.0, description="kg/m³.")
    cell_data: CellDataSettings | None = Field(None, description="Material read from the mesh file, cell by cell.")
    regions: tuple[MaterialRegionSettings, ...] = Field((), description="Other material in parts; the last one wins.")
    pins: tuple[RegionSettings, ...] = Field(min_length=1, description="Vertices that do not move by themselves.")
    gravity: Vector = Field((0.0, -9.8, 0.0), description="Acceleration, m/s².")
    loads: tuple[LoadSettings, ...] = Field((), description="Forces besides gravity.")
    time_step: Positive = Field(0.005, description="h, s.")

    @model_validator(mode="after")
    def _one(self) -> MeshSettings:
        if [self.file, self.shape, self.surface].count(None) != 2:
            raise ValueError("give exactly one of file, shape, surface")
        if self.cell_data is not None and self.file is None:
            raise ValueError("cell_data is read from a mesh file; with a shape or a surface use regions")
        return self


class PullSettings(Section):
    count: int = Field(ge=1, description="Number of pulls, one after another.")
    seed: int = Field(0, ge=0, description="Seed of where and which way.")
    reach: Positive = Field(description="How far the pointer goes from the surface, m.")
    stiffness: Positive = Field(30.0, description="Of the spring, N/m.")
    radius: Positive = Field(0.03, description="Vertices within it are held, m.")
    frames: int = Field(40, ge=2, description="Frames of one pull.")
    rest: int = Field(40, ge=0, description="Frames of free motion after each pull.")


class KeyframeSettings(Section):
    time: float = Field(ge=0, description="Since the beginning of the motion, s.")


class TargetSettings(KeyframeSettings):
    target: Vector = Field(description="Where the pointer is, m.")


class PoseSettings(KeyframeSettings):
    translation: Vector = Field((0.0, 0.0, 0.0), description="From the rest pose, m.")
    angle: float = Field(0.0, description="Turn about the axis from the rest pose, degrees.")


class AccelerationSettings(KeyframeSettings):
    acceleration: Vector = Field(description="Gravity, m/s².")


class PathSettings(Section):
    """Keyframes in time, and how to go from one to the next."""

    interpolation: Literal["eased", "linear"] = Field(
        "eased", description="Eased: each stretch starts and ends at rest; linear: at constant speed."
    )
    keyframes: tuple[KeyframeSettings, ...]

    @field_validator("keyframes")
    @classmethod
    def _a_path(cls, keyframes: tuple[KeyframeSettings, ...]) -> tuple[KeyframeSettings, ...]:
        if len(keyframes) < 2:
            raise ValueError(f"a path needs at least two keyframes, got {len(keyframes)}")
        times = [keyframe.time for keyframe in keyframes]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"the times of keyframes must rise, got {times}")
        return keyframes


class GrabSettings(PathSettings):
    point: Vector = Field(description="Where it takes hold, m.")
    at_rest: bool = Field(True, description="Whether the point is on the rest shape; false: on the deformed one.")
    stiffness: Positive = Field(30.0, description="Of the spring, N/m.")
    radius: Positive = Field(0.03, description="Vertices within it are held, m.")
    keyframes: tuple[TargetSettings, ...] = Field(description="Held from the first to the last, then let go.")


class MovingPinsSettings(PathSettings):
    where: RegionSettings = Field(description="Which of the pinned vertices.")
    axis: Vector = Field((0.0, 0.0, 1.0), description="Axis of the turn.")
    centre: Vector | None = Field(None, description="A point on the axis, m; left out, the middle of the vertices.")
    keyframes: tuple[PoseSettings, ...] = Field(description="The first must be the rest pose.")


class GravitySettings(PathSettings):
    keyframes: tuple[AccelerationSettings, ...] = Field(description="Gravity before, between and after them.")


class ScriptSettings(Section):
    """What happens at what time; grabs, moving pins and gravity may go together."""

    grabs: tuple[GrabSettings, ...] = Field((), description="Pulls of the pointer.")
    moving_pins: tuple[MovingPinsSettings, ...] = Field((), description="Pinned regions that follow a path.")
    gravity: GravitySettings | None = Field(None, description="Gravity that changes.")
    duration: Positive | None = Field(None, description="Length of the motion, s; left out, until the last keyframe.")

    @model_validator(mode="after")
    def _something(self) -> ScriptSettings:
        if not (self.grabs or self.moving_pins or self.gravity):
            raise ValueError("give at least one of grabs, moving_pins, gravity")
        return self


class GravitySweepSettings(Section):
    duration: Positive = Field(description="s.")
    turns: int = Field(4, ge=1, description="Turns of the spiral from the scene's gravity to its opposite.")
    size: Positive | None = Field(None, description="Of the acceleration, m/s²; left out, that of the scene's gravity.")


class ReleaseSettings(Section):
    """A grab that takes the solid slowly into a pose, waits until it is still, and lets go."""

    point: Vector = Field(description="Where it takes hold, on the rest shape, m.")
    target: Vector = Field(description="Where it takes the point, m.")
    stiffness: Positive = Field(300.0, description="Of the spring, N/m.")
    radius: Positive = Field(0.03, description="Vertices within it are held, m.")
    pull: Positive = Field(0.5, description="Time to get there, s.")
    hold: float = Field(0.5, ge=0, description="Time to come to rest there, s.")
    swing: Positive = Field(1.0, description="Time of free motion after that, s.")


class MotionSettings(Section):
    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", description="Name of the motion in every artefact.")
    role: Literal["train", "heldout"] | None = Field(
        None, description="Whether the model may learn from it; left out, train, or as heldout_share chooses."
    )
    recording: str | None = Field(None, description="CSV of a recorded interaction.")
    pulls: PullSettings | None = Field(None, description="Seeded random pulls.")
    script: ScriptSettings | None = Field(None, description="Keyframes of grabs, moving pins and gravity.")
    script_file: str | None = Field(None, description="The same in a YAML file of its own.")
    gravity_sweep: GravitySweepSettings | None = Field(None, description="Gravity from every direction in turn.")
    release: ReleaseSettings | None = Field(None, description="Into a pose by a grab, then let go.")
    frames: int | None = Field(None, ge=1, description="Use only the first frames.")

    @model_validator(mode="after")
    def _one(self) -> MotionSettings:
        if sum(getattr(self, kind) is not None for kind in MOTION_KINDS) != 1:
            raise ValueError(f"give exactly one of {', '.join(MOTION_KINDS)}")
        return self


class SnapshotSettings(Section):
    """Full-space runs that the model learns from and is judged on."""

    motions: tuple[MotionSettings, ...] = Field(min_length=1, description="What happens to the solid.")
    heldout_share: float = Field(
        0.0, ge=0, lt=1, description="Share of the motions without a role to hold out, at least one if above 0."
    )
    heldout_seed: int = Field(0, ge=0, description="Of the choice of these.")
    tolerance: Positive = Field(1e-6, description="Stop at ‖∇E‖ ≤ tolerance · max(‖u‖, 1), N.")
    method: Literal["lbfgs", "newton"] = Field("lbfgs", description="L-BFGS, or Newton with clamped Hessians.")
    linear_solver: Literal["auto", "direct", "multigrid"] = Field(
        "auto", description="Of the sparse systems; auto takes a direct factor where it fits in memory."
    )
    quasistatic: bool = Field(False, description="Leave inertia out: every frame is an equilibrium.")
    factor_cost: int = Field(25, ge=1, description="Cost of a factorisation, in iterations of L-BFGS.")
    max_iterations: int = Field(500, ge=1, description="Of the minimiser in one step.")
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
    method: Literal["exchange", "ecsw", "an", "nn_htp", "uniform"] = Field(
        "exchange", description="How the points are found (docs/cubature.md)."
    )
    project: Literal["latent", "linear"] = Field(
        "latent", description="Forces of the latent set: through the decoder's Jacobian, or in the space of U."
    )
    norm: Literal["compliance", "force"] = Field(
        "compliance", description="Forces measured by the displacement energy they cause at rest, or by their size."
    )
    tolerance: float = Field(0.045, gt=0, lt=1, description="Relative error of the reduced forces on the fitted poses.")
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
    candidates: int = Field(50_000, ge=1, description="Most points looked at, drawn at random where there are more.")
    threads: int = Field(0, ge=0, description="That share out the poses; 0 for one a core. The result is the same.")
    seed: int = Field(0, ge=0, description="Of the choice of poses and candidates.")


class SimulateSettings(Section):
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


AnySection = TypeVar("AnySection", bound=BaseModel)


def load_settings(path: Path) -> Settings:
    """Read and check a configuration.

    Raises:
        SettingsError: the file is missing or not YAML, or a key or value is not allowed; one line names each fault
            with its path, what was got and what is allowed.
    """
    if not path.is_file():
        raise SettingsError(f"configuration {path} does not exist; examples lie in configs/")
    return _validated(path, "configuration", Settings)


def load_script(path: Path) -> ScriptSettings:
    """Read and check a script of a motion; see `load_settings`."""
    return _validated(path, "script", ScriptSettings)


def _validated(path: Path, what: str, section: type[AnySection]) -> AnySection:
    """The content of a YAML file as a section."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise SettingsError(f"{what} {path} is not valid YAML: {reason}") from error
    if content is None:
        raise SettingsError(f"{what} {path} is empty; examples lie in configs/")
    if not isinstance(content, dict):
        raise SettingsError(f"{what} {path} holds {type(content).__name__}; expected a mapping of sections")
    return _checked(content, str(path), what, section)


def settings_of(content: Mapping[str, Any], source: str) -> Settings:
    """Check a configuration that was read, or made, elsewhere; `source` names it in messages.

    Raises:
        SettingsError: as `load_settings`.
    """
    return _checked(content, source, "configuration", Settings)


def _checked(content: Mapping[str, Any], source: str, what: str, section: type[AnySection]) -> AnySection:
    try:
        return section.model_validate(dict(content))
    except ValidationError as error:
        faults = "; ".join(_fault(dict(fault), what, section) for fault in error.errors())
        raise SettingsError(f"{what} {source}: {faults}") from error


def _fault(fault: dict[str, Any], what: str, root: type[BaseModel]) -> str:
    """One fault in words: the key's path, what is wrong, what was got, and the nearest known key."""
    where = ".".join(str(part) for part in fault["loc"]) or what
    if fault["type"] == "extra_forbidden":
        known = _known_keys(fault["loc"][:-1], root)
        near = difflib.get_close_matches(str(fault["loc"][-1]), known, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(sorted(known))}"
        return f"unknown key {where!r}; {hint}"
    if fault["type"] == "missing":
        return f"{where} is missing"
    got = "" if isinstance(fault["input"], dict | list) else f", got {fault['input']!r}"
    message = fault["msg"].removeprefix("Value error, ")
    return f"{where}: {message[:1].lower()}{message[1:]}{got}"


def _known_keys(location: tuple[int | str, ...], root: type[BaseModel]) -> list[str]:
    """The keys of the section at a path; union members and list indices are passed through."""
    sections: list[type[BaseModel]] = [root]
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
    if stage == "mesh":
        surface = settings.mesh.surface
        name = surface.file if surface is not None else settings.mesh.file
        return [] if name is None else [resolve_path(name, config)]
    if stage == "snapshot":
        motions = settings.snapshot.motions
        names = [name for motion in motions for name in (motion.recording, motion.script_file) if name is not None]
        return [resolve_path(name, config) for name in names]
    return []


def stamp(settings: Settings, stage: str, config: Path) -> str:
    """What a stage depends on besides artefacts: its settings and the hashes of its input files, as text."""
    lines = [dump(stage_settings(settings, stage))]
    for path in input_files(settings, stage, config):
        lines.append(f"# {path.name}: {hashlib.sha256(path.read_bytes()).hexdigest()}\n")
    return "".join(lines)
