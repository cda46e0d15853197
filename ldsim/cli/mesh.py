"""`ldsim mesh`: read or make the mesh and write the scene."""

from __future__ import annotations

import click

from ldsim.artefacts.records import write_scene
from ldsim.cli.stage import Run, stage_command
from ldsim.errors import SettingsError
from ldsim.mechanics.pins import Ball, Pin, Slab, pinned_vertices
from ldsim.mechanics.scene import Scene, uniform_scene
from ldsim.mesh.formats import read_mesh
from ldsim.mesh.mesh import Mesh, check_cells, reoriented
from ldsim.mesh.shapes import SHAPES
from ldsim.settings import MeshSettings, PinSettings, resolve_path


@stage_command("mesh", "Read or make the mesh and write the scene.")
def command(run: Run) -> None:
    scene = make_scene(run, run.settings.mesh)
    mesh = scene.mesh
    write_scene(run.path("scene"), run.header("scene", "mesh", ()), scene)
    run.done(
        "scene",
        f"{mesh.n_vertices} vertices, {mesh.n_cells} {mesh.cell_type} cells, {int(scene.pinned.sum())} vertices pinned"
        f", {scene.mass.sum():.3g} kg, diagonal {mesh.diagonal:.3g} m",
    )


def make_scene(run: Run, settings: MeshSettings) -> Scene:
    """The scene that the section `mesh` describes."""
    mesh = _mesh(run, settings)
    check_cells(mesh)
    return uniform_scene(
        mesh,
        pinned_vertices(mesh.vertices, [_pin(pin) for pin in settings.pins]),
        material=settings.material.model,
        youngs_modulus=settings.material.youngs_modulus,
        poisson_ratio=settings.material.poisson_ratio,
        density=settings.density,
        gravity=settings.gravity,
        time_step=settings.time_step,
    )


def _mesh(run: Run, settings: MeshSettings) -> Mesh:
    if settings.shape is not None:
        if settings.shape.name not in SHAPES:
            raise SettingsError(f"mesh.shape.name is {settings.shape.name!r}; known are {', '.join(SHAPES)}")
        return SHAPES[settings.shape.name](resolution=settings.shape.resolution, cell_type=settings.shape.cell_type)
    assert settings.file is not None
    read = read_mesh(resolve_path(settings.file, run.config), settings.scale)
    if read.dropped_vertices:
        click.echo(f"{read.dropped_vertices} vertices that no cell uses were dropped", err=True)
    return reoriented(read.mesh) if settings.reorient else read.mesh


def _pin(settings: PinSettings) -> Pin:
    if settings.slab is not None:
        return Slab(settings.slab.axis, settings.slab.at == "max", settings.slab.thickness)
    assert settings.ball is not None
    return Ball(settings.ball.centre, settings.ball.radius)
