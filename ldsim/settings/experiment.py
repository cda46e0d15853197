"""The sections of the stages, and the experiment that they make up."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from ldsim.cubature.options import CubatureOptions
from ldsim.errors import SettingsError
from ldsim.learn.options import TrainOptions
from ldsim.options import Name, Options, checked_options, read_options
from ldsim.pipeline.options import MeshOptions, SimulateOptions, SnapshotOptions
from ldsim.report.options import ReportOptions
from ldsim.space.options import PcaOptions

# Endings of files that are given where a configuration is asked for.
MESHES = tuple(".stl .obj .ply .off .glb .gltf .mesh .msh .vtk .vtu .xdmf .node .ele .inp .med .exo".split())


class Settings(Options):
    """One experiment."""

    experiment: Annotated[Name, Field(description="Name; files lie in runs/<experiment>/.")]
    mesh: MeshOptions
    snapshot: SnapshotOptions
    pca: PcaOptions = PcaOptions()
    train: TrainOptions = TrainOptions()
    cubature: CubatureOptions = CubatureOptions()
    simulate: SimulateOptions = SimulateOptions()
    report: ReportOptions = ReportOptions()

    @model_validator(mode="after")
    def _synthetic_motions_have_inertia(self) -> Settings:
        if self.snapshot.quasistatic and self.pca.synthetic is not None:
            raise ValueError("pca.synthetic steps with inertia, snapshot.quasistatic leaves it out; drop one")
        return self

    @model_validator(mode="after")
    def _simulated_motions_are_known(self) -> Settings:
        known = [motion.name for motion in self.snapshot.motions]
        for name in self.simulate.motions or ():
            if name not in known:
                raise ValueError(f"simulate.motions names {name!r}; the motions of snapshot are {', '.join(known)}")
        return self

    @model_validator(mode="after")
    def _a_condensed_space_can_be_made(self) -> Settings:
        """As far as can be seen before hours of full-space runs; the stage train looks at the rest."""
        train, pca = self.train, self.pca
        if train.kind != "condensed":
            return self
        if self.snapshot.quasistatic:
            raise ValueError("train.kind is condensed, but snapshot.quasistatic is true; use train.kind: autoencoder")
        if pca.inner_product != "mass":
            raise ValueError(
                f"train.kind is condensed; it needs pca.inner_product: mass, got {pca.inner_product}; or use "
                "train.kind: autoencoder"
            )
        for motion, role in zip(self.snapshot.motions, self.snapshot.roles, strict=True):
            if role != "test" and motion.script is not None and motion.script.moving_pins:
                raise ValueError(
                    f"train.kind is condensed, but pins move in motion {motion.name}; use train.kind: autoencoder"
                )
        return self

    @model_validator(mode="after")
    def _the_basis_has_as_many_columns_as_are_asked_for(self) -> Settings:
        """As far as can be seen before hours of full-space runs: it has no more than pca.k."""
        k, r, sizes = self.pca.columns, self.train.r, self.cubature.linear_sizes or ()
        if k is not None and r is not None and r > k:
            raise ValueError(f"train.r is {r}; allowed are 1 … {k}, the columns of the basis (pca.k)")
        if k is not None and max(sizes, default=0) > k:
            raise ValueError(f"cubature.linear_sizes has {max(sizes)}; the basis has {k} columns (pca.k)")
        return self

    def section(self, stage: str) -> Options:
        """The options of a stage."""
        section: Options = getattr(self, stage)
        return section


STAGES = tuple(name for name in Settings.model_fields if name != "experiment")


def load_settings(path: str | Path, experiment: str | None = None) -> Settings:
    """Read and check a configuration, and refuse one of another experiment; see `read_options`."""
    path = Path(path)
    if path.suffix.lower() in MESHES:
        raise SettingsError(
            f"{path} is a mesh or surface file, not a configuration; `ldsim new {path}` looks at it and writes "
            f"{path.with_suffix('.yaml').name}, which `ldsim make` takes"
        )
    settings = read_options(path, "configuration", Settings)
    if experiment not in (None, settings.experiment):
        raise SettingsError(
            f"configuration {path}: experiment is {settings.experiment!r}, expected {experiment!r}; make finds the "
            "files of an experiment by the name of its configuration"
        )
    return settings


def settings_of(content: Mapping[str, Any], source: str) -> Settings:
    """Check a configuration that was made, not read; `source` names it in messages."""
    return checked_options(content, f"configuration {source}", Settings)
