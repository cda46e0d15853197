"""A run: the folder of an experiment's artefacts, finished or growing, and all that can be made of them."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

from ldsim.arrays import Array
from ldsim.artefacts.records import (
    StoredModel,
    read_basis,
    read_cubature,
    read_fresh,
    read_model,
    read_scene,
    read_simulation,
)
from ldsim.artefacts.snapshots import Recorded, Snapshots
from ldsim.artefacts.store import STAGE_OF, WRITTEN_BY, Header, file_hash, read_header, reading
from ldsim.cubature.path import RulePath
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.trajectory import Trajectory
from ldsim.errors import ArtefactError, LdsimError, SolverError
from ldsim.mechanics.scene import Scene
from ldsim.options import Options
from ldsim.space.basis import Basis
from ldsim.space.lifting import Lifting
from ldsim.space.pca import Chunks, Pca
from ldsim.space.space import Space

if sys.platform != "win32":
    import resource

REDUCED = ("linear", "latent")
SPACES = ("full", *REDUCED)
AUTO = "auto"
Content = TypeVar("Content")


class Run:
    """A folder of artefacts that belong together. Each is read when it is first asked for, and checked once.

    Args:
        folder: such as runs/demo; made by the first stage that writes into it.
        experiment: its name, the folder's where it is left out.
    """

    def __init__(self, folder: str | Path, experiment: str | None = None) -> None:
        self.folder = Path(folder)
        self.experiment = self.folder.name if experiment is None else experiment
        self._named_by = ""
        self._read: dict[str, tuple[Any, Header]] = {}
        self._hashes: dict[str, str] = {}
        self._open: dict[str, Snapshots] = {}

    def __repr__(self) -> str:
        there = [kind for kind in STAGE_OF if self.path(kind).is_file()]
        return f"<Run: {self.experiment} in {self.folder}, {', '.join(there) or 'nothing yet'}>"

    @classmethod
    def open(cls, folder: str | Path) -> Run:
        """A run that is there, at least its scene.

        Raises:
            ArtefactError: the folder is none, or has no scene.
        """
        if not Path(folder).is_dir():
            raise ArtefactError(f"{folder} is not the folder of a run; give one such as runs/demo, made by `make`")
        run = cls(folder)
        with reading(run.path("scene"), "scene") as file:
            run.experiment = str(read_header(file).notes.get("experiment", run.experiment))
            run._named_by = f", as in {run.path('scene')}, the experiment"
        return run

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close snapshots.h5 and tests.h5, the artefacts that are kept open."""
        for found in self._open.values():
            found.close()
        self._open.clear()
        self.__dict__.pop("played", None)

    def path(self, kind: str) -> Path:
        """The file of an artefact: "scene", "snapshots", "tests", "basis", "model", "cubature" or "simulation"."""
        return self.folder / f"{kind}.h5"

    def header(self, kind: str) -> Header:
        """The header of an artefact."""
        if kind in self._open:
            return self._open[kind].header
        if kind in self._read:
            return self._read[kind][1]
        with reading(self.path(kind), kind) as file:
            return read_header(file)

    def require(self, *kinds: str) -> None:
        """Refuse artefacts that are missing, of another experiment, or made from other files than those beside them.

        Raises:
            ArtefactError: naming the file, what was found, what was expected, and what to do.
        """
        # of the files as they are now: what replaces one of them later is not what a stage has read
        for kind in kinds:
            self.hash(kind)
        self._check(*kinds)

    def _check(self, *kinds: str) -> None:
        for kind in kinds:
            header, path = self.header(kind), self.path(kind)
            experiment = header.notes.get("experiment")
            if experiment != self.experiment:
                raise ArtefactError(
                    f"{path} belongs to the experiment {experiment!r}, expected{self._named_by} {self.experiment!r}; "
                    "run make"
                )
            for name in set(kinds) & set(header.inputs):
                if header.inputs[name] != self.hash(name):
                    raise ArtefactError(
                        f"{path} was made from another {name} than {self.path(name)} (SHA-256 "
                        f"{header.inputs[name][:12]}… recorded); it belongs to another experiment or is stale: run make"
                    )

    def hash(self, kind: str) -> str:
        """SHA-256 of an artefact's file."""
        if kind not in self._hashes:
            with reading(self.path(kind), kind):
                self._hashes[kind] = file_hash(self.path(kind))
        return self._hashes[kind]

    def written(self, kind: str) -> None:
        """Forget what was read of an artefact, and of those made of it, because a stage has written it anew."""
        if kind in ("scene", "snapshots", "tests"):
            self.close()
        for name in [name for name, (_, header) in self._read.items() if name == kind or kind in header.inputs]:
            del self._read[name]
        self._hashes.pop(kind, None)
        for made in ("lifting", "every_lifting", "motions", "played"):
            self.__dict__.pop(made, None)

    def stage(self, name: str, options: Options) -> Stage:
        """The beginning of a stage that will write into this run."""
        return Stage(self, name, options)

    @property
    def scene(self) -> Scene:
        """The solid."""
        return self._get("scene", read_scene)

    @property
    def snapshots(self) -> Snapshots:
        """The full-space runs to learn from and to choose by, open for reading until the run is closed."""
        return self._opened("snapshots")

    @cached_property
    def played(self) -> Snapshots:
        """Those and the motions of the role test, for simulate and what follows: nothing before may look at them."""
        return self.snapshots.beside(self._opened("tests")) if self.path("tests").is_file() else self.snapshots

    def _opened(self, kind: str) -> Snapshots:
        if kind not in self._open:
            self._open[kind] = Snapshots(self.path(kind), self.scene.mesh.n_vertices, kind)
            self._check(kind, "scene")
        return self._open[kind]

    def recorded(self, motion: str) -> Recorded:
        """A motion as it ran in the full space."""
        if motion in self.snapshots.names:
            return self.snapshots.recorded(motion)
        return self.played.recorded(motion)

    def chunks(self, role: str) -> Chunks:
        """Snapshots of all motions of a role, one after another, without what moving pins prescribe."""
        source, lifting = (self.played, self.every_lifting) if role == "test" else (self.snapshots, self.lifting)
        names = source.with_role(role)
        motions = [source.recorded(name).motion for name in names]
        return lifting.taken_off(lambda: source.chunks(names), motions)

    @cached_property
    def motions(self) -> dict[str, Recorded]:
        """Every motion as it ran in the full space, in the order of the configuration, those of the role test last."""
        return {name: self.recorded(name) for name in self.played.names}

    @property
    def pca(self) -> Pca:
        """The basis with its singular values and errors."""
        return self._get("basis", lambda path: read_basis(path, self.scene), "scene")

    @property
    def basis(self) -> Basis:
        """U, all of its columns."""
        return self.pca.basis

    @property
    def model(self) -> StoredModel:
        """The latent space, an autoencoder or a condensed one, and how it came about."""
        return self._get("model", read_model, "basis")

    @property
    def cubature(self) -> dict[str, RulePath]:
        """The cubature rules of each reduced space."""
        read = partial(read_cubature, sizes={"s": self.scene.points.n_points})
        return self._get("cubature", read, "scene", "basis", "model")

    @property
    def simulation(self) -> dict[str, dict[str, Trajectory]]:
        """Space → motion → what `ldsim simulate` ran."""
        return self._get("simulation", read_simulation, "scene", "basis", "model", "cubature")

    @property
    def fresh_errors(self) -> dict[str, Array]:
        """Space → online errors of the fresh motions that a statement is from; empty where none is made."""
        self.require("simulation", "scene", "basis", "model", "cubature")
        return read_fresh(self.path("simulation"))

    @cached_property
    def lifting(self) -> Lifting:
        """Of every pin that moves in a motion to learn from or to choose by."""
        return Lifting.of(self.scene, [self.recorded(name).motion for name in self.snapshots.names])

    @cached_property
    def every_lifting(self) -> Lifting:
        """Of every pin that moves in any motion."""
        return Lifting.of(self.scene, [recorded.motion for recorded in self.motions.values()])

    def space(self, name: str, points: int | None = None, scene: Scene | None = None) -> Space:
        """A space with the cubature rule that was chosen for it.

        Args:
            name: "full", "latent", "linear" with kp columns, "linear_20" where a rule for that size was fitted, or
                "auto" (`chosen`).
            points: take the largest rule of at most so many points of the mesh instead.
            scene: the solid with another material, of which virtual points know nothing (`RulePath.stepped`).

        Raises:
            ArtefactError: there is no such space, or what it needs is missing or stale.
        """
        name = self.chosen if name == AUTO else name
        known = SPACES if name in SPACES else ("full", *self.cubature)
        if name not in known:
            raise ArtefactError(f"space is {name!r}; known are {AUTO}, {', '.join(known)}")
        solid = self.scene if scene is None else scene
        if name == "full":
            return Space.full(solid)
        basis, model, rules = self.basis, self.model, self.cubature[name]  # the first stage missing is named
        rule = rules.stepped(points, changed_material=scene is not None)
        try:
            if name != "latent":
                k = model.kp if name == "linear" else int(name.removeprefix("linear_"))
                space = replace(Space.linear(solid, basis, k, rule), name=name)
            else:
                space = replace(latent_space(solid, basis, model), rule=rule, novelty=model.novelty)
        except SolverError as error:
            raise ArtefactError(
                f"model.h5 and cubature.h5 of {self.folder} do not fit its basis.h5 ({error}); delete them and run make"
            ) from error
        return space.with_lifting(self.every_lifting if self.path("snapshots").is_file() else None)

    @property
    def chosen(self) -> str:
        """The space that simulate found to be the one to use for this solid; latent where it has not run since.

        Raises:
            ArtefactError: what simulate found is damaged.
        """
        if not self.path("simulation").is_file():
            return "latent"
        header = self.header("simulation")
        fits = header.inputs.get("cubature") == self.hash("cubature")
        return str(header.notes.get("space", "latent")) if fits else "latent"

    @property
    def quasistatic(self) -> bool:
        """Whether its full-space runs are equilibria, without inertia."""
        return bool(self.header("snapshots").notes.get("quasistatic", 0))

    @property
    def reduced_options(self) -> ReducedOptions:
        """How its motions are stepped in a reduced space, so that they compare with its full-space runs."""
        return ReducedOptions(quasistatic=self.quasistatic)

    def basis_of(self, space: str) -> Basis:
        """The basis in which a reduced space has its coordinates q; a condensed latent space has one of its own."""
        if space == "latent" and self.model.columns is not None:
            return Basis.of(self.model.columns, self.scene.mass)
        return self.basis

    def stepper(
        self, space: Space | str, tolerance: float | None = None, seconds: float = math.inf
    ) -> FullStepper | ReducedStepper:
        """What steps in a space, given itself or by its name.

        Args:
            tolerance: stop at ‖∇E‖ ≤ tolerance · max(‖x‖, 1), N; left out, the usual one of the space.
            seconds: after which a step of the full space begins no further iteration.
        """
        space = self.space(space) if isinstance(space, str) else space
        if space.basis is None:
            return FullStepper(space.scene, FullOptions(tolerance=tolerance), seconds=seconds)
        return ReducedStepper(space, ReducedOptions(tolerance=tolerance))

    def _get(self, kind: str, read: Callable[[Path], tuple[Content, Header]], *inputs: str) -> Content:
        """An artefact, read once; checked to be made from the small artefacts that lie beside it."""
        if kind not in self._read:
            self._read[kind] = read(self.path(kind))
            try:
                self._check(kind, *inputs)
            except LdsimError:
                del self._read[kind]
                raise
        found: Content = self._read[kind][0]
        return found


def linear_name(k: int, kp: int) -> str:
    """The name of the linear space of k columns; the one that reconstructs as the decoder does is called linear."""
    return "linear" if k == kp else f"linear_{k}"


def latent_space(scene: Scene, basis: Basis, model: StoredModel) -> Space:
    """The space of a model, with every quadrature point."""
    networks = (model.decoder, model.encoder)
    if model.columns is None:
        return Space.latent(scene, basis, networks)
    columns = Basis.of(model.columns, basis.metric)
    return Space.condensed(scene, columns, networks, CubatureRule.every(scene), model.squares, model.turns)


class Stage:
    """A stage at work: since when, with what options, for the header of what it will write."""

    def __init__(self, run: Run, name: str, options: Options) -> None:
        self._run, self._name, self._options = run, name, options
        self._started = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Since the stage began."""
        return time.perf_counter() - self._started

    @property
    def cost(self) -> dict[str, float]:
        """Its seconds and memory so far."""
        return {"seconds": self.seconds, "peak_memory_mb": peak_memory_mb()}

    def header(self, kind: str, inputs: tuple[str, ...] = (), seed: int = -1, **notes: str | float | int) -> Header:
        """The header of the artefact that the stage writes now."""
        assert WRITTEN_BY[kind] == self._name
        return Header(
            kind,
            self._options.dump(),
            {name: self._run.hash(name) for name in inputs},
            seed,
            {"experiment": self._run.experiment, "stage": self._name, **self.cost, **notes},
        )


def peak_memory_mb() -> float:
    """Largest resident memory of this process or one of its workers so far, MB (10⁶ bytes); 0 on Windows."""
    if sys.platform == "win32":
        return 0.0
    usage = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return usage * (1 if sys.platform == "darwin" else 1024) / 1e6
