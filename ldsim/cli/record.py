"""`ldsim record`: pull a coarse mesh in the browser and record a motion."""

from __future__ import annotations

from pathlib import Path

import click

from ldsim import __version__
from ldsim.artefacts.atomic import writing
from ldsim.cli.app import browser_option, port_option, until_closed_option
from ldsim.cli.stage import Bars
from ldsim.errors import SettingsError
from ldsim.mechanics.loads import usual_grip
from ldsim.mechanics.recording import read_recording
from ldsim.pipeline.mesh import described_scene
from ldsim.pipeline.options import MeshOptions
from ldsim.settings import load_settings
from ldsim.settings.starting import COARSE_CELLS, is_surface, starting_settings, write_configuration
from ldsim.viewer.playground import record_server
from ldsim.viewer.recorder import Recorder
from ldsim.viewer.serving import serve

CONFIGURATIONS = (".yaml", ".yml")


@click.command("record", help="Pull the solid of a configuration, or of a MESH or surface file, and record it.")
@click.version_option(__version__, "--version", prog_name="ldsim")
@click.argument("source", metavar="CONFIG|MESH", type=click.Path(path_type=Path))
@click.option(
    "--output", type=click.Path(path_type=Path, dir_okay=False), default=Path("motion.csv"), show_default=True
)
@click.option("--mesh", type=click.Path(path_type=Path), help="A coarser mesh of the configuration's solid.")
@click.option("--resolution", type=click.IntRange(1, 64), help="Of the configuration's shape, where it has one.")
@click.option("--cells", type=click.IntRange(min=10), help="Tets that a surface is filled with, about.")
@click.option("--play", type=click.Path(path_type=Path), help="A recording to play back.")
@click.option("--stiffness", type=click.FloatRange(0, min_open=True), help="Of a grab, N/m.")
@click.option("--radius", type=click.FloatRange(0, min_open=True), help="Of a grab, m.")
@click.option("--config", type=click.Path(path_type=Path), help="For a MESH file: write a configuration of all stages.")
@click.option(
    "--scale",
    type=click.FloatRange(0, min_open=True),
    default=1.0,
    show_default=True,
    help="Of a MESH file: metres a unit.",
)
@click.option(
    "--youngs-modulus",
    type=click.FloatRange(0, min_open=True),
    default=1e5,
    show_default=True,
    help="Of a MESH file, Pa.",
)
@click.option(
    "--pin",
    type=click.Choice(["x", "y", "z"]),
    default="y",
    show_default=True,
    help="A MESH file is pinned at its low end; with z gravity is along z too, else along y.",
)
@port_option
@browser_option
@until_closed_option
def command(
    source: Path,
    output: Path,
    mesh: Path | None,
    resolution: int | None,
    cells: int | None,
    play: Path | None,
    stiffness: float | None,
    radius: float | None,
    config: Path | None,
    scale: float,
    youngs_modulus: float,
    pin: str,
    port: int,
    browser: bool,
    until_closed: bool,
) -> None:
    described = source.suffix.lower() in CONFIGURATIONS
    if described and config is not None:
        raise SettingsError(f"--config is for a mesh or surface file; {source} is a configuration already")
    if config is not None:
        if config.exists():
            raise SettingsError(f"{config} exists already; give --config another name, or record on {config} itself")
        with writing(config):
            config.parent.mkdir(parents=True, exist_ok=True)
    place = source if described else config or source.with_suffix(".yaml")
    settings = (
        load_settings(source) if described else starting_settings(source, place, scale, youngs_modulus, pin, output)
    )
    if not described and is_surface(source):
        cells = cells or COARSE_CELLS
    section = _coarser(settings.mesh, place, mesh, resolution, cells)
    scene = described_scene(section, Bars(), place.parent)[0]
    if config is not None:
        write_configuration(config, settings, scene)
        click.echo(f"{config}: record {output}, then run its stages (ldsim mesh {config}, …)", err=True)
    usual_stiffness, usual_radius = usual_grip(scene)
    recorder = Recorder(
        output,
        stiffness or usual_stiffness,
        radius or usual_radius,
        {"recorded_on": source.name, "time_step_s": scene.time_step},
        None if play is None else read_recording(play, play.stem),
    )
    serve(record_server(scene, source.stem, recorder, port, until_closed), browser, click.echo, Bars().tell)


def _coarser(
    section: MeshOptions, config: Path, mesh: Path | None, resolution: int | None, cells: int | None
) -> MeshOptions:
    """The section `mesh` on a coarser mesh, where one is given."""
    changes: dict[str, object] = {}
    if mesh is not None:
        changes = {"file": str(mesh.absolute()), "shape": None, "surface": None}
    elif resolution is not None:
        if section.shape is None:
            raise SettingsError(f"--resolution needs mesh.shape in {config}; for a mesh file give a coarser --mesh")
        changes = {"shape": section.shape.model_copy(update={"resolution": resolution})}
    elif cells is not None:
        if section.surface is None:
            raise SettingsError(f"--cells needs mesh.surface in {config}; for a mesh file give a coarser --mesh")
        changes = {"surface": section.surface.model_copy(update={"cells": cells, "edge_length": None})}
    return section.model_copy(update=changes | {"refine": 0}) if changes else section
