"""What `ldsim record` starts with: a configuration, or a mesh or surface file that comes without one."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from ldsim.artefacts.atomic import replacing, writing
from ldsim.errors import SettingsError
from ldsim.mechanics.grabs import usual_grip
from ldsim.mechanics.recording import read_recording
from ldsim.mechanics.scene import Scene
from ldsim.mesh.formats import read_mesh, read_surface
from ldsim.options import Field, Options, Positive
from ldsim.pipeline.mesh import described_scene
from ldsim.pipeline.options import MeshOptions
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.settings.experiment import Settings, load_settings, settings_of
from ldsim.viewer.recorder import Recorder

CONFIGURATIONS = (".yaml", ".yml")
SURFACES = (".stl", ".obj", ".ply", ".off")
# Of the extent of the file along the axis that it is pinned on.
PINNED_SHARE = 0.05
# Tets of a surface: few for the hand, more for the model.
COARSE_CELLS, FINE_CELLS = 2000, 10_000
# How far pulls go, and the errors that PCA and the autoencoder may leave, in diagonals. How
# many numbers a motion needs is not known before: a fixed r was larger than the basis of the first one that was tried.
REACH, PCA_TOLERANCE, TRAIN_TOLERANCE = 0.2, 0.0005, 0.004


class RecordOptions(Options):
    """On what a motion is recorded by hand, and where to."""

    output: Annotated[Path, Field(description="The recording.")] = Path("motion.csv")
    mesh: Annotated[Path | None, Field(description="A coarser mesh of the configuration's solid.")] = None
    resolution: Annotated[
        int | None, Field(ge=1, le=64, description="Of the configuration's shape, where it has one.")
    ] = None
    cells: Annotated[int | None, Field(ge=10, description="Tets that a surface is filled with, about.")] = None
    play: Annotated[Path | None, Field(description="A recording to play back.")] = None
    stiffness: Annotated[Positive | None, Field(description="Of a grab, N/m.")] = None
    radius: Annotated[Positive | None, Field(description="Of a grab, m.")] = None
    config: Annotated[Path | None, Field(description="For a MESH file: write a configuration of all stages.")] = None
    scale: Annotated[Positive, Field(description="Of a MESH file: metres a unit.")] = 1.0
    youngs_modulus: Annotated[Positive, Field(description="Of a MESH file, Pa.")] = 1e5
    pin: Annotated[
        Literal["x", "y", "z"],
        Field(description="A MESH file is pinned at its low end; with z gravity is along z too, else along y."),
    ] = "y"


def recording_scene(source: Path, options: RecordOptions, progress: Progress = SILENT) -> tuple[Scene, Recorder]:
    """The scene of a configuration, or of a mesh or surface file, coarse enough for the hand, and what records on it.

    Where `options.config` is given, the configuration of all stages is written there.

    Raises:
        LdsimError: the file cannot be read or does not fit the options, or the configuration is there already.
    """
    described = source.suffix.lower() in CONFIGURATIONS
    _check_config(source, described, options.config)
    place = source if described else options.config or source.with_suffix(".yaml")
    settings = load_settings(source) if described else starting_settings(source, place, options)
    if not described and source.suffix.lower() in SURFACES and options.cells is None:
        options = options.replace(cells=COARSE_CELLS)
    scene, _ = described_scene(_coarser(settings.mesh, place, options), progress, place.parent)
    if options.config is not None:
        write_configuration(place, settings, scene)
        progress.tell(f"{place}: record {options.output}, then run its stages (ldsim mesh {place}, …)")
    stiffness, radius = usual_grip(scene)
    notes: dict[str, str | float] = {"recorded_on": source.name, "time_step_s": scene.time_step}
    motion = None if options.play is None else read_recording(options.play, options.play.stem)
    grip = (options.stiffness or stiffness, options.radius or radius)
    return scene, Recorder(options.output, *grip, notes, motion)


def _check_config(source: Path, described: bool, config: Path | None) -> None:
    if config is None:
        return
    if described:
        raise SettingsError(f"--config is for a mesh or surface file; {source} is a configuration already")
    if config.exists():
        raise SettingsError(f"{config} exists already; give --config another name, or record on {config} itself")
    with writing(config):
        config.parent.mkdir(parents=True, exist_ok=True)


def starting_settings(source: Path, config: Path, options: RecordOptions) -> Settings:
    """A solid of the usual material, pinned at the low end of an axis, that learns from one recording.

    Args:
        config: where the configuration would lie; its paths are relative to that folder.

    Raises:
        MeshError: the file cannot be read.
    """
    surface, scale, axis = source.suffix.lower() in SURFACES, options.scale, options.pin
    vertices = (read_surface(source, scale) if surface else read_mesh(source, scale).mesh).vertices
    thickness = PINNED_SHARE * float(np.ptp(vertices[:, "xyz".index(axis)]))
    file = os.path.relpath(source, config.parent)
    recording = os.path.relpath(options.output, config.parent)
    content = {
        "experiment": re.sub(r"[^A-Za-z0-9_.-]+", "-", source.stem).lstrip(".")[:100] or "solid",
        "mesh": {
            **({"surface": {"file": file, "cells": FINE_CELLS}} if surface else {"file": file}),
            "scale": scale,
            "material": {"youngs_modulus": options.youngs_modulus},
            "pins": [{"slab": {"axis": axis, "at": "min", "thickness": float(f"{thickness:.3g}")}}],
            **({"gravity": [0.0, 0.0, -9.8]} if axis == "z" else {}),  # it stands on its low end
        },
        "snapshot": {"motions": [{"name": "by_hand", "role": "train", "recording": recording}]},
        "cubature": {"poses": 200, "heldout_poses": 50},
    }
    return settings_of(content, str(source))


def _coarser(section: MeshOptions, config: Path, options: RecordOptions) -> MeshOptions:
    """The section `mesh` on a coarser mesh, where one is given."""
    changes: dict[str, Any] = {}
    if options.mesh is not None:
        changes = {"file": str(options.mesh.absolute()), "shape": None, "surface": None}
    elif options.resolution is not None:
        if section.shape is None:
            raise SettingsError(f"--resolution needs mesh.shape in {config}; for a mesh file give a coarser --mesh")
        changes = {"shape": section.shape.replace(resolution=options.resolution)}
    elif options.cells is not None:
        if section.surface is None:
            raise SettingsError(f"--cells needs mesh.surface in {config}; for a mesh file give a coarser --mesh")
        changes = {"surface": section.surface.replace(cells=options.cells, edge_length=None)}
    return section.replace(**changes, refine=0) if changes else section


def write_configuration(path: Path, settings: Settings, scene: Scene) -> None:
    """Write a starting configuration, with random and synthetic pulls to learn from and a few others to judge it by.

    Raises:
        ArtefactError: it cannot be written.
    """
    stiffness, radius = usual_grip(scene)
    diagonal = scene.mesh.diagonal
    numbers = {"reach": REACH * diagonal, "stiffness": stiffness, "radius": radius}
    pulls = {"rest": 60} | {name: float(f"{value:.3g}") for name, value in numbers.items()}
    content = settings.model_dump(mode="json", exclude_unset=True)
    content["snapshot"]["motions"] += [
        {"name": "pulls", "role": "train", "pulls": {"count": 8, "seed": 2} | pulls},
        {"name": "others", "role": "validation", "pulls": {"count": 4, "seed": 1} | pulls},
        {"name": "unseen", "role": "test", "pulls": {"count": 4, "seed": 4} | pulls},
    ]
    for stage, share in (("pca", PCA_TOLERANCE), ("train", TRAIN_TOLERANCE)):
        content[stage] = {"tolerance_mm": float(f"{1e3 * share * diagonal:.3g}")}
    content["pca"]["synthetic"] = {"count": 60, "seed": 3} | pulls
    with replacing(path) as temporary:
        temporary.write_text(settings_of(content, str(path)).dump(defaults=False), encoding="utf-8")
