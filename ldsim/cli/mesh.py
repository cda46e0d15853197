"""`ldsim mesh`: read or make the mesh and write the scene."""

from __future__ import annotations

from collections.abc import Mapping

import click
import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import write_scene
from ldsim.cli.filling import Notes, filled_surface
from ldsim.cli.regions import region
from ldsim.cli.stage import Run, stage_command
from ldsim.errors import SettingsError
from ldsim.mechanics.dead_loads import body_force, pressure_force, surface_force
from ldsim.mechanics.pins import pinned_vertices
from ldsim.mechanics.properties import Change, Properties
from ldsim.mechanics.quadrature import quadrature
from ldsim.mechanics.regions import cells_in
from ldsim.mechanics.scene import Scene, make_scene
from ldsim.mesh.formats import read_mesh
from ldsim.mesh.mesh import Mesh, check_cells, reoriented
from ldsim.mesh.refine import CHILDREN, refined
from ldsim.mesh.shapes import SHAPES
from ldsim.settings import MeshSettings, ShapeSettings, resolve_path

Array = NDArray[np.float64]
Numbers = Mapping[str, Array]


@stage_command("mesh", "Read or make the mesh and write the scene.")
def command(run: Run) -> None:
    scene, notes = described_scene(run, run.settings.mesh)
    mesh = scene.mesh
    write_scene(run.path("scene"), run.header("scene", "mesh", (), -1, **notes), scene)
    run.done(
        "scene",
        f"{mesh.n_vertices} vertices, {mesh.n_cells} {mesh.cell_type} cells, {int(scene.pinned.sum())} vertices pinned"
        f", {scene.mass.sum():.3g} kg, diagonal {mesh.diagonal:.3g} m",
    )


def described_scene(run: Run, settings: MeshSettings) -> tuple[Scene, Notes]:
    """The scene that the section `mesh` describes, and what the header of its artefact says of it."""
    cell_data: Numbers = {}
    if settings.surface is not None:
        mesh, notes = filled_surface(run, settings.surface)
    else:
        (mesh, cell_data), notes = _mesh(run, settings), {}
    check_cells(mesh)
    pinned = pinned_vertices(mesh, [region(place) for place in settings.pins])
    properties = _properties(settings, mesh, cell_data)
    load = _load(settings, mesh, properties)
    return make_scene(mesh, pinned, properties, settings.gravity, settings.time_step, load), notes


def _mesh(run: Run, settings: MeshSettings) -> tuple[Mesh, Numbers]:
    """The mesh and the numbers that its file gives to each cell."""
    mesh, cell_data = (_shape(settings.shape), {}) if settings.shape is not None else _file(run, settings)
    for _ in range(settings.refine):
        mesh = refined(mesh)
        cell_data = {name: np.repeat(values, CHILDREN) for name, values in cell_data.items()}
    return mesh, cell_data


def _shape(settings: ShapeSettings) -> Mesh:
    if settings.name not in SHAPES:
        raise SettingsError(f"mesh.shape.name is {settings.name!r}; known are {', '.join(SHAPES)}")
    return SHAPES[settings.name](resolution=settings.resolution, cell_type=settings.cell_type)


def _file(run: Run, settings: MeshSettings) -> tuple[Mesh, Numbers]:
    assert settings.file is not None
    read = read_mesh(resolve_path(settings.file, run.config), settings.scale)
    if read.dropped_vertices:
        click.echo(f"{read.dropped_vertices} vertices that no cell uses were dropped", err=True)
    return reoriented(read.mesh) if settings.reorient else read.mesh, read.cell_data


def _properties(settings: MeshSettings, mesh: Mesh, cell_data: Numbers) -> Properties:
    """The scene's material, then what the file says of each cell, then the regions in their order."""
    material = settings.material
    properties = Properties.uniform(
        mesh.n_cells, material.model, material.youngs_modulus, material.poisson_ratio, settings.density
    )
    if settings.cell_data is not None:
        names = settings.cell_data
        modulus, ratio = _column(names.youngs_modulus, cell_data), _column(names.poisson_ratio, cell_data)
        density = _column(names.density, cell_data)
        properties = properties.changed(Change(youngs_modulus=modulus, poisson_ratio=ratio, density=density))
    for part in settings.regions:
        change = Change(**part.material.model_dump(), density=part.density)
        properties = properties.changed(change, cells_in(region(part.where), mesh, "changes"))
    return properties


def _column(name: str | None, cell_data: Numbers) -> Array | None:
    if name is None:
        return None
    if name not in cell_data:
        known = ", ".join(cell_data) or "none"
        raise SettingsError(f"mesh.cell_data: the mesh file gives no number {name!r} to its cells; known are {known}")
    return cell_data[name]


def _load(settings: MeshSettings, mesh: Mesh, properties: Properties) -> Array | None:
    """The sum of all loads, (n, 3) N; None without."""
    forces = []
    for load in settings.loads:
        place = region(load.where)
        if load.acceleration is not None:
            points = quadrature(mesh)
            forces.append(body_force(mesh, points, properties.density, place, load.acceleration))
        if load.traction is not None:
            forces.append(surface_force(mesh, place, load.traction))
        if load.pressure is not None:
            forces.append(pressure_force(mesh, place, load.pressure))
    return sum(forces[1:], start=forces[0]) if forces else None
