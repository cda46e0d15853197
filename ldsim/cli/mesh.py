"""`ldsim mesh`: read or make the mesh and write the scene."""

from __future__ import annotations

import click

from ldsim.cli.stage import Call, stage_command
from ldsim.pipeline.mesh import mesh
from ldsim.pipeline.solid import solid_lines


@stage_command("mesh", "Read or make the mesh and write the scene.")
def command(call: Call) -> None:
    scene = mesh(call.run, call.settings.mesh, call.progress, call.base)
    call.done(
        "scene",
        f"{scene.mesh.n_vertices} vertices, {scene.mesh.n_cells} {scene.mesh.cell_type} cells, "
        f"{int(scene.pinned.sum())} vertices pinned, {scene.mass.sum():.3g} kg, diagonal {scene.mesh.diagonal:.3g} m",
    )
    for line in solid_lines(scene, call.settings.snapshot):
        click.echo(line)
