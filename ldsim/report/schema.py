"""report.json: every key with its type, unit and meaning; made, written and checked by one model.

The contract for every program that reads a run. Lengths are in millimetres and times in seconds unless a key says
otherwise. A value that was not measured is null, never missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from ldsim.artefacts.store import STAGE_OF
from ldsim.run import SPACES

Role = Literal["train", "validation", "test"]
STAGES = (*STAGE_OF.values(), "report")
ROLES: tuple[str, ...] = get_args(Role)
ROLE_NAMES = {"train": "training", "validation": "validation", "test": "test"}

MM_PER_M = 1000.0

Number = float | None
Count = int | None


def _about(sentence: str) -> Any:
    return Field(description=sentence)


def _without_unknown(value: object, known: Iterable[str]) -> object:
    unknown = sorted(set(map(str, value)) - set(known)) if isinstance(value, Mapping) else []
    if unknown:
        found: dict[str, Any] = {"key": unknown[0], "known": ", ".join(known)}
        raise PydanticCustomError("unknown", "{key} is unknown; known are {known}", found)
    return value


class ReportSection(BaseModel):
    """An object of report.json: exactly its keys, only finite numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def __getitem__(self, key: str) -> Any:
        return getattr(self, key)

    @model_validator(mode="before")
    @classmethod
    def _names_unknown_keys(cls, value: object) -> object:
        return _without_unknown(value, cls.model_fields)


class MachineDescription(ReportSection):
    cpu: str
    cores: Annotated[Count, _about("cores that the process may use")]
    gpu: str | None
    versions: Annotated[dict[str, str], _about("package → version")]


class MeshSize(ReportSection):
    vertices: Count
    cells: Count
    cell_type: str
    quadrature_points: Count


class Dimensions(ReportSection):
    k: Annotated[Count, _about("columns that the decoder's output is of: of the basis, or a condensed space's own")]
    r: Annotated[Count, _about("latent dimension")]
    kp: Annotated[Count, _about("columns of the linear space to compare with: as good as an autoencoder, else all")]


class VertexErrors(ReportSection):
    """Vertex distance over a set of poses."""

    max_mm: Number
    mean_mm: Number


class Reconstruction(ReportSection):
    """Error of projecting the poses of one role on each space."""

    autoencoder: Annotated[
        VertexErrors | None,
        _about("the latent space, also a condensed one, but without what pulls and weight move beside its coordinates"),
    ]
    pca_r: Annotated[VertexErrors | None, _about("the linear space of r columns")]
    pca_kp: Annotated[VertexErrors | None, _about("the linear space of kp columns")]
    pca_k: Annotated[VertexErrors | None, _about("the linear space of the whole basis")]


class RoleReconstructions(ReportSection):
    train: Reconstruction | None
    validation: Reconstruction | None
    test: Reconstruction | None


class ForceErrors(ReportSection):
    """Relative error of the reduced forces."""

    fitted: Annotated[Number, _about("on the poses that the rule was fitted to")]
    kept_back: Annotated[Number, _about("on poses of the training motions that were kept back from the fit")]


class VirtualRule(ReportSection):
    """Virtual quadrature points, stepped instead of those on the mesh unless simulate.points says otherwise."""

    points: Count
    relative_error: ForceErrors


class RuleNumbers(ReportSection):
    """The cubature rule of one space."""

    points: Annotated[Count, _about("points on the mesh")]
    relative_error: ForceErrors
    virtual: VirtualRule | None
    stepped: Annotated[Count, _about("points of the rule that simulate stepped with, virtual or on the mesh")]
    seconds: Annotated[Number, _about("time of the fit")]


class Cubatures(ReportSection):
    latent: RuleNumbers | None
    linear: RuleNumbers | None


class OnlineError(ReportSection):
    """Vertex distance to the full-space run of the same motion."""

    relative: Annotated[Number, _about("mean distance over the mean displacement of the full-space run")]
    windowed: Annotated[Number, _about("the same, restarted from the full-space state every window")]
    max_mm: Number
    mean_mm: Number


class NoveltyNumbers(ReportSection):
    """The novelty score of a latent run: its distance to the training codes."""

    median: Number
    threshold: Annotated[Number, _about("score from which on a frame is warned of")]
    share_above: Annotated[Number, _about("share of the frames above the threshold")]
    rank_correlation: Annotated[Number, _about("Spearman's, of score and mean vertex distance")]
    rank_correlation_remembered: Annotated[Number, _about("the same of the score averaged over the last half second")]
    rank_correlation_time: Annotated[Number, _about("the same of the time alone, which knows nothing of the model")]


class MotionRun(ReportSection):
    """One motion in one space."""

    motion: str
    role: Role
    frames: Annotated[Count, _about("steps that were made")]
    median_step_ms: Number
    p95_step_ms: Number
    p99_step_ms: Number
    iterations: Annotated[Number, _about("mean of a step")]
    evaluations: Annotated[Number, _about("mean of a step")]
    online_error: OnlineError | None
    novelty: NoveltyNumbers | None
    diverged: bool


class SpaceRuns(ReportSection):
    full: list[MotionRun]
    linear: list[MotionRun]
    latent: list[MotionRun]


class FrontierRun(ReportSection):
    """One reduced space, with the rule that was stepped, on one motion."""

    space: Annotated[str, _about("latent, linear with kp columns, or linear_20")]
    dimension: Annotated[Count, _about("numbers that it moves by")]
    points: Annotated[Count, _about("quadrature points of the rule that was stepped")]
    motion: str
    role: Role
    median_step_ms: Number
    online_error: Annotated[Number, _about("mean vertex distance over mean displacement; null where it diverged")]
    windowed_error: Annotated[Number, _about("the same, restarted from the full-space state every window")]


class Speedups(ReportSection):
    """Median step of the slower space over that of the faster one, over the same frames of the same motions."""

    latent_over_linear_equal_error: Annotated[
        Number,
        _about("against the fastest linear space that is at least as good on the motions of `judged_on`; null: none"),
    ]
    judged_on: Annotated[Role | None, _about("role of the motions that say what is as good")]
    latent_error: Annotated[Number, _about("online error of the latent space on them")]
    linear_space: Annotated[str | None, _about("that linear space, or where there is none the one of least error")]
    linear_error: Annotated[Number, _about("its online error on them")]
    latent_over_linear_kp: Annotated[Number, _about("against the linear space of kp columns, whatever its error")]
    latent_over_full: Annotated[Number, _about("against the full space, on the stretch that it was timed on")]
    chosen_over_full: Annotated[Number, _about("the same of the space that simulate chose: the headline's number")]


class StatementBound(ReportSection):
    """Of one space."""

    error: Annotated[Number, _about("online error that the quantile stays within; null where too many were lost")]
    median: Annotated[Number, _about("of the fresh motions")]
    lost: Annotated[Count, _about("of the fresh motions")]


class Statement(ReportSection):
    """What holds of motions like some fresh ones that nothing had seen."""

    sentence: Annotated[str, _about("in words, of the latent space")]
    about: Annotated[str, _about("what the motions are")]
    motions: Count
    quantile: Annotated[Number, _about("share of such motions, smaller than asked where they were too few")]
    confidence: Number
    latent: StatementBound
    linear: StatementBound


class LearningRound(ReportSection):
    """A round of `ldsim make --error`."""

    error: Annotated[Number, _about("largest online error of a pull of the validation motions; null: lost")]
    pulls: Count
    seconds: Number
    changed: Annotated[str, _about("settings that were extended after it; empty where none were")]


class Verdict(ReportSection):
    """What all that comes to, of the space that simulate chose."""

    word: Annotated[
        Literal["good", "usable", "do not use", "not judged"],
        _about("good: at most 10 % off by the statement, else on test, validation or training motions; usable: 30 %"),
    ]
    why: str


class MadeFrom(ReportSection):
    """What the report tells of: `ldsim make` compares it with what is there."""

    configuration: Annotated[str, _about("of all stages, as YAML, without what is default")]

    settings: Annotated[str, _about("of the stage report, as YAML")]
    inputs: Annotated[dict[str, str], _about("artefact → SHA-256 of its file")]


class StageCost(ReportSection):
    seconds: Number
    peak_memory_mb: Annotated[Number, _about("largest resident memory of one process, 10⁶ bytes")]


class RunNumbers(ReportSection):
    """The content of report.json."""

    experiment: str
    created: Annotated[str, _about("date and time, UTC")]
    verdict: Verdict
    machine: MachineDescription
    mesh: MeshSize
    kind: Annotated[Literal["autoencoder", "condensed"], _about("train.kind, what the latent space is")]
    dims: Dimensions
    reconstruction: RoleReconstructions
    rest_residual_mm: Annotated[Number, _about("largest displacement of a vertex that the decoder gives the rest pose")]
    cubature: Cubatures
    simulate: SpaceRuns
    window_seconds: Annotated[float, _about("after which restarted runs begin anew (simulate.window)")]
    space: Annotated[str, _about("what load, play and export use by default")]
    frontier: Annotated[list[FrontierRun], _about("every reduced space on every motion")]
    speedup: Speedups
    statement: Statement | None
    rounds: Annotated[list[LearningRound], _about("rounds of `ldsim make --error`; empty where no error was asked for")]
    made_from: MadeFrom
    stages: Annotated[dict[str, StageCost], BeforeValidator(lambda value: _without_unknown(value, STAGES))]
    warnings: list[str]
    advice: Annotated[list[str], _about("which space to use for this solid, and why")]
    remedies: Annotated[list[str], _about("what to change, the most promising first; empty where no number is bad")]

    def headline_runs(self) -> dict[str, MotionRun]:
        """Space → its run of the motion that headlines are about: the first test motion, else a validation one."""
        runs = [run for space in ("latent", "linear", "full") for run in self.simulate[space]]
        motion = max(runs, key=lambda run: ROLES.index(run.role)).motion if runs else None
        return {space: run for space in SPACES for run in self.simulate[space] if run.motion == motion}

    def headline(self) -> FrontierRun | None:
        """The run of the space that simulate chose on that motion."""
        motion = next((run.motion for run in self.headline_runs().values()), None)
        return next((run for run in self.frontier if (run.space, run.motion) == (self.space, motion)), None)


def check_report(report: object) -> list[str]:
    """Every way in which `report`, read from JSON, breaks the contract, one sentence each; empty when it keeps it."""
    try:
        RunNumbers.model_validate(report)
    except ValidationError as error:
        return [_violation(dict(fault)) for fault in error.errors()]
    return []


def _violation(fault: dict[str, Any]) -> str:
    """One fault in words: the path, what was got, and what is allowed."""
    path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in fault["loc"]).lstrip(".")
    if fault["type"] == "missing":
        return f"{path} is missing"
    if fault["type"] == "unknown":
        return f"{path}.{fault['msg']}".lstrip(".")
    allowed = "an object" if fault["type"] == "model_type" else fault["msg"].removeprefix("Input should be ")
    return f"{path or 'the report'} is {fault['input']!r}; expected {allowed}"
