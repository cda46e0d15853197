"""The options of the stages mesh, snapshot and simulate, which put together those of the rooms below."""

from __future__ import annotations

import math
import random
from typing import Annotated, Literal

from ldsim.arrays import Array
from ldsim.dynamics.full.options import FullOptions, weights, within
from ldsim.dynamics.reduced.options import MinimiserOptions
from ldsim.mechanics.options import (
    EARTH,
    CellDataOptions,
    GravitySweepOptions,
    LoadOptions,
    MaterialChangeOptions,
    MaterialOptions,
    MaterialRegionOptions,
    PullOptions,
    ReleaseOptions,
    ScriptOptions,
)
from ldsim.mechanics.regions import Region
from ldsim.mesh.options import ShapeOptions, SurfaceOptions
from ldsim.options import Field, Name, Options, Positive, Seed, Vector, exactly_one, model_validator

# Where simulate has no tolerance: N, and between which shares it stays, in full space of the norm of the weights of all
# vertices, in reduced ones of the weight in coordinates that are orthonormal in the mass.
STOP, OF_WEIGHTS, OF_REDUCED = 1e-8, (1e-9, 1e-6), (1e-10, 1e-7)


class MeshOptions(Options):
    """The scene: all that is physical."""

    file: Annotated[str | None, Field(description="Volume mesh in a format that meshio reads.")] = None
    shape: Annotated[ShapeOptions | None, Field(description="A procedural shape instead of a file.")] = None
    surface: Annotated[
        SurfaceOptions | None, Field(description="A closed triangle surface instead, filled with tets.")
    ] = None
    scale: Annotated[Positive, Field(description="Factor from the file's unit to metres.")] = 1.0
    refine: Annotated[int, Field(ge=0, le=4, description="Cut every tet into eight, this many times.")] = 0
    reorient: Annotated[bool, Field(description="Flip left-handed cells instead of refusing them.")] = False
    material: MaterialOptions
    density: Annotated[Positive, Field(description="kg/m³.")] = 1000.0
    cell_data: Annotated[
        CellDataOptions | None, Field(description="Material read from the mesh file, cell by cell.")
    ] = None
    regions: Annotated[
        tuple[MaterialRegionOptions, ...], Field(description="Other material in parts; the last one wins.")
    ] = ()
    pins: Annotated[tuple[Region, ...], Field(min_length=1, description="Vertices that do not move by themselves.")]
    gravity: Annotated[Vector, Field(description="Acceleration, m/s².")] = (0.0, -9.8, 0.0)
    loads: Annotated[tuple[LoadOptions, ...], Field(description="Forces besides gravity.")] = ()
    time_step: Annotated[Positive, Field(description="h, s.")] = 0.005

    _one = exactly_one("file", "shape", "surface")

    @model_validator(mode="after")
    def _of_a_file(self) -> MeshOptions:
        if self.cell_data is not None and self.file is None:
            raise ValueError("cell_data is read from a mesh file; with a shape or a surface use regions")
        if self.scale != 1 and self.shape is not None:
            raise ValueError(f"scale is {self.scale:g}, but a shape is given in metres; scale is of a file's unit")
        if self.reorient and self.file is None:
            raise ValueError("reorient is of the cells of a mesh file; a shape and a surface's filling need it not")
        return self

    @property
    def input_files(self) -> tuple[str, ...]:
        """The files that it names, as it names them."""
        name = self.file if self.surface is None else self.surface.file
        return () if name is None else (name,)


class MotionOptions(Options):
    """One motion: what pulls on the solid, and whether the model may learn from it."""

    name: Annotated[Name, Field(description="Name of the motion in every artefact.")]
    role: Annotated[
        Literal["train", "validation", "test"] | None,
        Field(
            description="train: learned from; validation: choices and thresholds may look at it; test: nothing reads "
            "it before simulate. Left out, train, or as test_share chooses."
        ),
    ] = None
    recording: Annotated[str | None, Field(description="CSV of a recorded interaction.")] = None
    pulls: Annotated[PullOptions | None, Field(description="Seeded random pulls.")] = None
    script: Annotated[ScriptOptions | None, Field(description="Keyframes of grabs, moving pins and gravity.")] = None
    script_file: Annotated[str | None, Field(description="The same in a YAML file of its own.")] = None
    gravity_sweep: Annotated[GravitySweepOptions | None, Field(description="Gravity from every direction in turn.")] = (
        None
    )
    release: Annotated[ReleaseOptions | None, Field(description="Into a pose by a grab, then let go.")] = None
    frames: Annotated[int | None, Field(ge=1, description="Use only the first frames.")] = None

    _one = exactly_one("recording", "pulls", "script", "script_file", "gravity_sweep", "release")


class SnapshotOptions(FullOptions):
    """Full-space runs that the model learns from and is judged on."""

    motions: Annotated[tuple[MotionOptions, ...], Field(min_length=1, description="What happens to the solid.")]
    test_share: Annotated[
        float,
        Field(ge=0, lt=1, description="Share of the motions without a role for role test, at least one if above 0."),
    ] = 0.0
    test_seed: Annotated[Seed, Field(description="Of the choice of these.")] = 0
    workers: Annotated[int, Field(ge=1, le=1024, description="Motions that run side by side.")] = 2

    @model_validator(mode="after")
    def _distinct(self) -> SnapshotOptions:
        names = [motion.name for motion in self.motions]
        if len({name.casefold() for name in names}) < len(names):  # each has a file, and some systems fold their names
            raise ValueError(f"motions must have different names, and not by case alone; got {', '.join(names)}")
        if "train" not in self.roles:
            raise ValueError("at least one motion must have the role train")
        return self

    @property
    def roles(self) -> tuple[str, ...]:
        """The role of each motion, given or chosen."""
        open_ = [i for i, motion in enumerate(self.motions) if motion.role is None]
        count = max(round(self.test_share * len(open_)), 1) if self.test_share > 0 and open_ else 0
        # by a number of each name, so that with further motions those that were tests mostly stay tests
        chosen = sorted(open_, key=lambda i: random.Random(f"{self.test_seed} {self.motions[i].name}").random())[:count]
        return tuple(motion.role or ("test" if i in chosen else "train") for i, motion in enumerate(self.motions))

    @property
    def learned(self) -> SnapshotOptions:
        """With the motions of snapshots.h5 alone, each with its role."""
        return self._only(("train", "validation"))

    @property
    def tests(self) -> SnapshotOptions:
        """With the motions of tests.h5 alone, which nothing reads before simulate; there may be none."""
        return self._only(("test",))

    def _only(self, roles: tuple[str, ...]) -> SnapshotOptions:
        pairs = zip(self.motions, self.roles, strict=True)
        motions = tuple(motion.replace(role=role) for motion, role in pairs if role in roles)
        chosen = {"motions": motions, "test_share": 0.0, "test_seed": 0}
        usual = {name: type(self).model_fields[name].default for name in ("workers", "linear_solver")}
        return self.model_copy(update=chosen | usual)  # what is usual changes no frame

    @property
    def solver(self) -> FullOptions:
        """Those of the solver alone."""
        return FullOptions(**self.model_dump(include=set(FullOptions.model_fields)))

    @property
    def seed(self) -> int:
        """Of the first random pulls; −1 where there are none."""
        return next((motion.pulls.seed for motion in self.motions if motion.pulls is not None), -1)

    @property
    def input_files(self) -> tuple[str, ...]:
        """The files that it names, as it names them."""
        files = (name for motion in self.motions for name in (motion.recording, motion.script_file))
        return tuple(name for name in files if name is not None)


class StatementOptions(Options):
    """Random motions that nothing has seen, to say how far the model is off on such motions."""

    motions: Annotated[int, Field(ge=1, le=10_000, description="How many; 59 for 95 % at 95 % confidence.")] = 59
    quantile: Annotated[float, Field(gt=0, lt=1, description="Share of such motions that it is said of.")] = 0.95
    confidence: Annotated[float, Field(gt=0, lt=1, description="With which it is said.")] = 0.95
    pulls: Annotated[PullOptions, Field(description="What one of them is; each has a seed of its own, made from this.")]


class SimulateOptions(Options):
    """How the motions are run and judged."""

    motions: Annotated[tuple[str, ...] | None, Field(min_length=1, description="Which motions; left out, all.")] = None
    points: Annotated[
        int | None, Field(ge=1, description="The largest latent rule of at most so many points; left out, the best.")
    ] = None
    linear_points: Annotated[int | None, Field(ge=1, description="The same for the linear space of kp columns.")] = None
    space: Annotated[
        Literal["auto", "latent", "linear"],
        Field(
            description="What load, play and export use by default; auto takes the fastest of the spaces whose error "
            "on the validation motions is nearly the least."
        ),
    ] = "auto"
    minimiser: Annotated[
        MinimiserOptions | None, Field(description="Of all reduced spaces; left out, each has the fastest of four.")
    ] = None
    tolerance: Annotated[
        float | None,
        Field(
            gt=0,
            description="Stop at ‖∇E‖ ≤ tolerance · max(‖z‖, 1), N; left out, 10⁻⁸, and where the solid is very light "
            "or very heavy, within bounds that follow from its weight.",
        ),
    ] = None
    max_iterations: Annotated[int, Field(ge=1, description="Of one reduced step.")] = 200
    full_frames: Annotated[
        int, Field(ge=1, description="Frames of the full space to time, from the first grab on.")
    ] = 100
    material: Annotated[
        MaterialChangeOptions | None,
        Field(description="Another material than that of the scene, for all motions; no errors are computed then."),
    ] = None
    statement: Annotated[
        StatementOptions | None, Field(description="A bound of the error on fresh motions; left out, none.")
    ] = None
    window: Annotated[
        Positive, Field(description="Restart from the full space this often for the windowed error, s.")
    ] = 0.25

    def stops(self, vertex_mass: Array) -> tuple[float, float]:
        """The tolerances of the full and of reduced spaces, N, for vertices of so many kg.

        Where a solid is of usual size they are one, the paper's (Sec. 5.2). A gradient in coordinates that are
        orthonormal in the mass grows with its root, one of the full space with the weights.
        """
        if self.tolerance is not None:
            return self.tolerance, self.tolerance
        reduced = EARTH * math.sqrt(float(vertex_mass.sum()))
        return within(STOP, weights(vertex_mass), OF_WEIGHTS), within(STOP, reduced, OF_REDUCED)
