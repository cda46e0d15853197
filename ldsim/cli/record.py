"""`ldsim record`: pull a coarse mesh in the browser and record a motion."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from ldsim import __version__
from ldsim.cli.mesh import described_scene
from ldsim.cli.serving import browser_option, port_option, serve, until_closed_option
from ldsim.cli.stage import Run
from ldsim.errors import SettingsError
from ldsim.mechanics.motion import usual_grip
from ldsim.mechanics.pins import pinned_vertices
from ldsim.mechanics.recording import read_recording
from ldsim.mechanics.regions import Slab
from ldsim.mechanics.scene import Scene, uniform_scene
from ldsim.mesh.formats import read_mesh
from ldsim.mesh.mesh import check_cells
from ldsim.settings import load_settings
from ldsim.viewer.playground import record_server
from ldsim.viewer.recorder import Recorder

CONFIGURATIONS = (".yaml", ".yml")
# Of the extent of a mesh file along the axis that it is pinned on.
PINNED_SHARE = 0.02


@click.command("record", help="Pull the solid of a configuration or of a MESH file in the browser and record it.")
@click.version_option(__version__, "--version", prog_name="ldsim")
@click.argument("source", metavar="CONFIG|MESH", type=click.Path(path_type=Path))
@click.option(
    "--output", type=click.Path(path_type=Path, dir_okay=False), default=Path("motion.csv"), show_default=True
)
@click.option("--mesh", type=click.Path(path_type=Path), help="A coarser mesh of the configuration's solid.")
@click.option("--resolution", type=click.IntRange(1, 64), help="Of the configuration's shape, where it has one.")
@click.option("--play", type=click.Path(path_type=Path), help="A recording to play back.")
@click.option("--stiffness", type=click.FloatRange(0, min_open=True), help="Of a grab, N/m.")
@click.option("--radius", type=click.FloatRange(0, min_open=True), help="Of a grab, m.")
@click.option("--scale", type=click.FloatRange(0, min_open=True), default=1.0, help="Of a MESH file: metres a unit.")
@click.option("--youngs-modulus", type=click.FloatRange(0, min_open=True), default=1e5, help="Of a MESH file, Pa.")
@click.option("--pin", type=click.Choice(["x", "y", "z"]), default="y", help="A MESH file is pinned at its low end.")
@port_option
@browser_option
@until_closed_option
def command(
    source: Path,
    output: Path,
    mesh: Path | None,
    resolution: int | None,
    play: Path | None,
    stiffness: float | None,
    radius: float | None,
    scale: float,
    youngs_modulus: float,
    pin: str,
    port: int,
    browser: bool,
    until_closed: bool,
) -> None:
    if source.suffix.lower() in CONFIGURATIONS:
        scene = _of_configuration(source, mesh, resolution)
    else:
        scene = _of_mesh(source, scale, youngs_modulus, "xyz".index(pin))
    usual_stiffness, usual_radius = usual_grip(scene)
    recorder = Recorder(
        output,
        stiffness or usual_stiffness,
        radius or usual_radius,
        {"recorded_on": source.name, "time_step_s": scene.time_step},
        None if play is None else read_recording(play, play.stem),
    )
    serve(record_server(scene, source.stem, recorder, port, until_closed), browser)


def _of_configuration(source: Path, mesh: Path | None, resolution: int | None) -> Scene:
    """The scene of a configuration, on a coarser mesh where one is given."""
    settings = load_settings(source)
    section = settings.mesh
    if mesh is not None:
        section = section.model_copy(update={"file": str(mesh.absolute()), "shape": None, "surface": None, "refine": 0})
    elif resolution is not None:
        if section.shape is None:
            raise SettingsError(f"--resolution needs mesh.shape in {source}; for a mesh file give a coarser --mesh")
        section = section.model_copy(
            update={"shape": section.shape.model_copy(update={"resolution": resolution}), "refine": 0}
        )
    return described_scene(Run(source, settings, source.parent), section)[0]


def _of_mesh(source: Path, scale: float, youngs_modulus: float, axis: int) -> Scene:
    """A mesh file of the usual material, pinned at the low end of an axis."""
    mesh = read_mesh(source, scale).mesh
    check_cells(mesh)
    low_end = Slab("xyz"[axis], False, PINNED_SHARE * float(np.ptp(mesh.vertices[:, axis])))
    return uniform_scene(mesh, pinned_vertices(mesh, [low_end]), youngs_modulus=youngs_modulus)
