"""What `ldsim record` starts with: a configuration, or a mesh or surface file that comes without one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import yaml

from ldsim.artefacts.atomic import replacing, writing
from ldsim.errors import SettingsError
from ldsim.mechanics.grabs import usual_grip
from ldsim.mechanics.recording import read_recording
from ldsim.mechanics.scene import Scene, properties_of, with_properties
from ldsim.options import Field, Positive
from ldsim.pipeline.files import relative_path
from ldsim.pipeline.mesh import described_scene
from ldsim.pipeline.options import MeshOptions
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.settings.experiment import Settings, load_settings, settings_of
from ldsim.settings.new import Given, NewOptions, configuration, seen, with_recordings
from ldsim.viewer.recorder import Recorder

CONFIGURATIONS = (".yaml", ".yml")
RECORDING = Path("motion.csv")
# Tets of a surface, few enough for the hand.
COARSE_CELLS = 2000


class RecordOptions(Given):
    """On what a motion is recorded by hand, and where to; for a MESH file also what is known of the solid."""

    output: Annotated[
        Path | None, Field(description="The recording, a new file; else motion.csv here, or motion-2.csv and so on.")
    ] = None
    mesh: Annotated[Path | None, Field(description="A coarser mesh of the configuration's solid.")] = None
    resolution: Annotated[
        int | None, Field(ge=1, le=64, description="Of the configuration's shape, where it has one.")
    ] = None
    cells: Annotated[int | None, Field(ge=10, description="Tets that a surface is filled with, about.")] = None
    play: Annotated[Path | None, Field(description="A recording to play back.")] = None
    stiffness: Annotated[
        Positive | None, Field(description="Of a grab, N/m; of the configuration's pulls where it has some.")
    ] = None
    radius: Annotated[Positive | None, Field(description="Of a grab, m; of the configuration's pulls likewise.")] = None
    config: Annotated[Path | None, Field(description="For a MESH file: write a configuration of all stages.")] = None


def recording_scene(source: Path, options: RecordOptions, progress: Progress = SILENT) -> tuple[Scene, Recorder]:
    """The scene of a configuration, or of a mesh or surface file, coarse enough for the hand, and what records on it.

    Where `options.config` is given, the configuration of all stages is written there with the first take, and again
    with every other; without a take there is none.

    Raises:
        LdsimError: the file cannot be read or does not fit the options, or the configuration or the recording is there
            already.
    """
    if source.is_dir():
        raise SettingsError(f"{source} is a folder; give a mesh, a surface or a configuration")
    described = source.suffix.lower() in CONFIGURATIONS
    _check_config(source, described, options.config)
    _refuse_unused(source, described, options)
    if options.output is not None and options.output.exists():
        raise SettingsError(f"{options.output} exists already; give another --output")
    if described:
        settings = load_settings(source)
        section = _coarser(settings.mesh, source, options)
        (scene, _), text = described_scene(section, progress, source.parent), ""
    else:
        scene, settings, text = _of_file(source, options, progress)
    stiffness, radius = _grip(settings, scene)
    notes: dict[str, str | float] = {"recorded_on": source.name, "time_step_s": scene.time_step}
    motion = None if options.play is None else read_recording(options.play, options.play.stem)
    grip = (options.stiffness or stiffness, options.radius or radius)
    written = partial(_write_configuration, options.config, text)
    return scene, Recorder(options.output or RECORDING, grip, notes, motion, written)


def _grip(settings: Settings, scene: Scene) -> tuple[float, float]:
    """Stiffness and radius of the configuration's own pulls, so that a hand pulls like what a model learns from."""
    pulls = next((motion.pulls for motion in settings.snapshot.motions if motion.pulls is not None), None)
    return usual_grip(scene) if pulls is None else (pulls.stiffness, pulls.radius)


def _refuse_unused(source: Path, described: bool, options: RecordOptions) -> None:
    """Refuse what would be left out without a word."""
    said = [name.replace("_", "-") for name, value in options.given().items() if value is not None]
    if described and said:
        raise SettingsError(f"--{said[0]} is for a mesh or surface file; {source} says it itself")
    coarser = [name for name in ("mesh", "resolution", "cells") if getattr(options, name) is not None]
    if len(coarser) > 1:
        raise SettingsError(f"give one of --{' and --'.join(coarser)}: each says what is recorded on")


def _check_config(source: Path, described: bool, config: Path | None) -> None:
    if config is None:
        return
    if described:
        raise SettingsError(f"--config is for a mesh or surface file; {source} is a configuration already")
    if config.exists():
        raise SettingsError(f"{config} exists already; give --config another name, or record on {config} itself")
    with writing(config):
        config.parent.mkdir(parents=True, exist_ok=True)


def _write_configuration(place: Path | None, text: str, takes: Sequence[Path]) -> None:
    """The configuration that learns from the takes that there are."""
    if place is None:
        return
    if not takes:
        place.unlink(missing_ok=True)
        return
    with replacing(place) as temporary:
        temporary.write_text(
            with_recordings(text, [relative_path(take, place.parent) for take in takes]), encoding="utf-8"
        )


def _of_file(source: Path, options: RecordOptions, progress: Progress) -> tuple[Scene, Settings, str]:
    """A solid without a configuration, as `ldsim new` would have it, and the settings and text of one."""
    place = options.config or source.with_suffix(".yaml")
    geometry = seen(source, place, NewOptions.model_validate(options.given()))
    section = geometry.options
    if section.surface is not None and options.cells is None:
        options = options.replace(cells=COARSE_CELLS)
    scene, _ = described_scene(_coarser(section, place, options), progress, place.parent)
    text, said = configuration(geometry, scene, options.youngs_modulus)
    for line in said:
        progress.tell(line)
    settings = settings_of(yaml.safe_load(text), str(place))
    if options.config is not None:
        progress.tell(f"{place} is written when something has been recorded; then `ldsim make {place}`")
    changed = with_properties(scene, properties_of(scene).changed(**settings.mesh.material.model_dump()))
    return replace(changed, time_step=settings.mesh.time_step), settings, text


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
