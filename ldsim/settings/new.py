"""A configuration that fits a solid, made by looking at it; every value in it is an ordinary setting."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml

from ldsim.artefacts.atomic import replacing, writing
from ldsim.errors import SettingsError
from ldsim.mechanics.scene import Scene
from ldsim.mesh.formats import read_mesh, read_surface
from ldsim.mesh.options import ShapeOptions
from ldsim.mesh.shapes import shaped
from ldsim.mesh.surface import surface_triangles
from ldsim.options import Field, Options, Positive
from ldsim.pipeline.files import relative_path
from ldsim.pipeline.mesh import mesh
from ldsim.pipeline.options import MeshOptions
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.pipeline.solid import Solid, described, length, look_at
from ldsim.run import Run
from ldsim.settings import derived
from ldsim.settings.experiment import settings_of

SURFACES = (".stl", ".obj", ".ply", ".off", ".glb", ".gltf")
CELLS = 10_000
# A share of the largest extent; less than this is rounding.
THIN = 1e-6
MODEL, POISSON = "stable_neo_hookean", 0.45

TEMPLATE = """\
# Made by `ldsim new`. Every value is a setting that can be changed; comments say what it was derived from. What is left
# out follows from solid and motions; `ldsim settings` shows it.
experiment: {name}
mesh:
  {geometry}
  # {material}
  material: {{model: {model}, youngs_modulus: {modulus}, poisson_ratio: {poisson}}}
  density: 1000
  time_step: {step} # a fortieth of its slowest oscillation, {slowest:.3g} Hz
snapshot:
  # reach: a quarter of its size, or less where that strains it by a half; stiffness: that of the solid where it is
  # neither soft nor stiff; radius: holds a hundredth of its surface
  motions:
    - {{name: pulls_1, role: train, pulls: {{count: 10, seed: 1, {pulls}}}}}
    - {{name: pulls_2, role: train, pulls: {{count: 10, seed: 2, {pulls}}}}}
    # never learned from: `ldsim make --error` is judged by each of these
    - {{name: others, role: validation, pulls: {{count: 30, seed: 3, rest: 20, {pulls}}}}}
    - {{name: unseen, role: test, pulls: {{count: 5, seed: 4, {pulls}}}}}
simulate:
  # the error that is stated: pulls like these, which nothing else has seen; for 95 % at 95 % confidence it is the worst
  # of 59, the second of 93, the third of 124
  statement: {{motions: 93, pulls: {{count: 1, seed: 8, rest: 20, {pulls}}}}}
"""


class Given(Options):
    """What can be said of a solid that comes as a file; what is not is seen or assumed."""

    unit: Annotated[Literal["mm", "cm", "m", "in"] | None, Field(description="Of the file; else by its size.")] = None
    pin: Annotated[
        Literal["x-min", "x-max", "y-min", "y-max", "z-min", "z-max"] | None,
        Field(description="The end that is held; else a flat one."),
    ] = None
    youngs_modulus: Annotated[
        Positive | None, Field(description="Pa; else that of soft rubber, or more where its weight asks for it.")
    ] = None

    def given(self) -> dict[str, object]:
        """These alone."""
        return self.model_dump(include=set(Given.model_fields))


class NewOptions(Given):
    """What can be said of a solid that a configuration is made for."""

    shape: Annotated[str | None, Field(description="A procedural shape instead of a file, such as beam.")] = None
    resolution: Annotated[int, Field(ge=1, le=64, description="Of a shape: cubes across its thinnest side.")] = 3
    cells: Annotated[int, Field(ge=10, description="Tets that a surface is filled with, about.")] = CELLS
    output: Annotated[Path | None, Field(description="The configuration; else NAME.yaml, here.")] = None


@dataclass(frozen=True)
class Geometry:
    """Where a solid comes from, as the section mesh says it, its unit, and where it is held.

    Attributes:
        lines: of the section mesh.
        said: what was assumed.
        options: the section, with a material to look at it with.
    """

    name: str
    lines: tuple[str, ...]
    said: tuple[str, ...]
    options: MeshOptions


def new(source: Path | None, options: NewOptions, runs: Path, progress: Progress = SILENT) -> tuple[Path, list[str]]:
    """Look at a solid and write a configuration for it; its scene is made on the way.

    Returns:
        The path of the configuration, and what was seen and assumed, in plain lines.

    Raises:
        LdsimError: the solid cannot be read or simulated, its unit is not clear, or there is a configuration or a run
            of its name.
    """
    if (source is None) == (options.shape is None):
        raise SettingsError("give a surface or mesh file, or --shape NAME, and not both")
    _refuse_unused(source, options)
    place = options.output or Path(f"{_name(source.stem if source else str(options.shape))}.yaml")
    if place.exists():
        raise SettingsError(f"{place} exists already; run it with `ldsim make {place}`, or give another --output")
    geometry = seen(source, place, options)
    with Run(runs / geometry.name, geometry.name) as run:
        if run.path("snapshots").exists() or any(run.folder.glob("snapshots.partial/*")):
            raise SettingsError(f"{run.folder} holds motions of a run already; give another --output")
        with writing(place):
            place.parent.mkdir(parents=True, exist_ok=True)
        scene = mesh(run, geometry.options, progress, place.parent)
        text, said = configuration(geometry, scene, options.youngs_modulus)
        settings = settings_of(yaml.safe_load(text), str(place))
        with replacing(place) as temporary:
            temporary.write_text(text, encoding="utf-8")
        mesh(run, settings.mesh, SILENT, place.parent)  # of a surface, the tets that were made are kept
    return place, said


def _refuse_unused(source: Path | None, options: NewOptions) -> None:
    """Refuse what this solid has no use for: it would be left out without a word."""
    usual, surface = NewOptions.model_fields, source is not None and source.suffix.lower() in SURFACES
    unused = {
        "unit": (options.unit is not None and source is None, "a file; a shape is in metres"),
        "resolution": (options.resolution != usual["resolution"].default and source is not None, "a --shape"),
        "cells": (options.cells != usual["cells"].default and not surface, "a surface, which is filled with tets"),
    }
    for name, (given, what) in unused.items():
        if given:
            raise SettingsError(f"--{name} is for {what}")


def seen(source: Path | None, place: Path, options: NewOptions) -> Geometry:
    """A file or a shape with its unit and its pins.

    Args:
        place: of the configuration; the path of the file is relative to its folder.

    Raises:
        LdsimError: it cannot be read, or its unit is not clear.
    """
    name = _name(place.stem)
    if source is None:
        shape = ShapeOptions(name=str(options.shape), resolution=options.resolution)
        made = shaped(shape)
        vertices, triangles, lines = made.vertices, surface_triangles(made), [f"shape: {_flow(shape)}"]
        said = []
    else:
        file, surface = relative_path(source, place.parent), source.suffix.lower() in SURFACES
        if surface:
            read = read_surface(source)
            vertices, triangles = read.vertices, read.faces.astype(np.int32)
            lines = [f"surface: {{file: {_quoted(file)}, cells: {options.cells}}}"]
        else:
            volume = read_mesh(source).mesh
            vertices, triangles = volume.vertices, surface_triangles(volume)
            lines = [f"file: {_quoted(file)}", "reorient: true"]
        extents = np.ptp(vertices, axis=0)
        if extents.min() <= THIN * extents.max():
            raise SettingsError(f"{source} is flat along {'xyz'[extents.argmin()]}; a solid is needed")
        diagonal = float(np.linalg.norm(extents))
        unit = options.unit or derived.unit_of(diagonal, surface)
        scale = derived.METRES[unit]
        vertices = vertices * scale
        said = [f"unit: {derived.WORDS[unit]}, so that it is {length(scale * diagonal)} across (--unit)"]
        lines.append(f"scale: {scale:g} # {said[0]}")
    pins = derived.pins_of(vertices, triangles.astype(np.int64), options.pin)
    axis = "xyz"[pins.axis]
    said.append(f"held at {axis}-{pins.at}, {length(pins.thickness)} deep: {pins.why} (--pin)")
    lines += [
        f"pins: # {said[-1]}",
        f"  - slab: {{axis: {axis}, at: {pins.at}, thickness: {pins.thickness:g}}}",
        f"gravity: {list(pins.gravity)}",
    ]
    content = yaml.safe_load("\n".join(lines)) | {"material": {"model": MODEL, "youngs_modulus": derived.SOFT}}
    return Geometry(name, tuple(lines), tuple(said), MeshOptions(**content))


def configuration(geometry: Geometry, scene: Scene, youngs_modulus: float | None = None) -> tuple[str, list[str]]:
    """The text of a configuration for a solid, and in plain lines what was assumed and what the solid then does.

    Args:
        scene: made with the geometry's options, or coarser.

    Raises:
        SettingsError: it is too large to be looked at.
    """
    solid = look_at(scene)
    if solid is None:
        raise SettingsError(f"{geometry.name} is too large to be looked at in this machine's memory; use fewer cells")
    factor, why = derived.stiffening(solid), "soft rubber"
    if youngs_modulus is not None:
        factor, why = youngs_modulus / derived.SOFT, "as you say"
    elif factor > 1:
        why = f"{factor:g} times soft rubber's, so that it stands its own weight"
    values = _values(solid, derived.SOFT * factor)
    material = f"Young's modulus {values['modulus']} Pa: {why} (--youngs-modulus)"
    lines = "\n  ".join(geometry.lines)
    text = TEMPLATE.format(name=_quoted(geometry.name), geometry=lines, material=material, **values)
    motions = settings_of(yaml.safe_load(text), geometry.name).snapshot.motions
    pulls = [each.pulls for each in motions if each.pulls is not None]
    return text, [*geometry.said, material, *described(solid.stiffened(factor), pulls[:1])]


def with_recordings(text: str, recordings: Sequence[str]) -> str:
    """A configuration of `configuration` that also learns from motions by hand, by the paths of their files."""
    lines = [
        f"    - {{name: {name}, role: train, recording: {_quoted(file)}}}\n"
        for name, file in zip(["by_hand", *(f"by_hand_{i}" for i in range(2, 99))], recordings, strict=False)
    ]
    return text.replace("\n  motions:\n", "\n  motions:\n" + "".join(lines), 1)


def _values(solid: Solid, modulus: float) -> dict[str, object]:
    """What follows from a solid that was looked at while it was of soft rubber, as the template has it."""
    solid = solid.stiffened(modulus / derived.SOFT)
    pulls = {
        "reach": derived.reach_of_pulls(solid),
        "stiffness": derived.stiffness_of_pulls(solid),
        "radius": derived.rounded(solid.radius),
    }
    said = ", ".join(f"{name}: {_number(value)}" for name, value in pulls.items())
    return {
        "model": MODEL,
        "modulus": _number(modulus),
        "poisson": POISSON,
        "step": _number(derived.time_step(solid)),
        "slowest": solid.frequencies[0],
        "pulls": said,
    }


def _name(stem: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", stem).lstrip(".-")[:100] or "solid"


def _quoted(text: str) -> str:
    """A text as YAML has it, in quotes where it would be something else without."""
    return yaml.safe_dump([text], default_flow_style=True, width=10_000, allow_unicode=True).strip()[1:-1]


def _flow(options: Options) -> str:
    text: str = yaml.safe_dump(options.model_dump(mode="json"), default_flow_style=True, sort_keys=False)
    return text.strip()


def _number(value: float) -> str:
    """As YAML reads it, without digits that mean nothing."""
    text = f"{value:g}"
    return text if "e" not in text or "." in text else text.replace("e", ".0e")
