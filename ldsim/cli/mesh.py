"""`ldsim mesh`: read or make the mesh and write the scene."""

from __future__ import annotations

import click

from ldsim.cli.stage import Call, stage_command
from ldsim.errors import ArtefactError
from ldsim.pipeline.mesh import mesh
from ldsim.settings.derived import looked_at
from ldsim.settings.make import FILES, Staleness


@stage_command("mesh", "Read or make the mesh and write the scene.")
def command(call: Call) -> None:
    if _up_to_date(call):
        scene = call.run.scene
        call.progress.tell(f"{call.run.path('scene')} is left as it is, for nothing that it was made from has changed")
    else:
        scene = mesh(call.run, call.settings.mesh, call.progress, call.base)
    call.done(
        "scene",
        f"{scene.mesh.n_vertices} vertices, {scene.mesh.n_cells} {scene.mesh.cell_type} cells, "
        f"{int(scene.pinned.sum())} vertices pinned, {scene.mass.sum():.3g} kg, diagonal {scene.mesh.diagonal:.3g} m",
    )
    for line in looked_at(call.settings, scene):
        click.echo(line)


def _up_to_date(call: Call) -> bool:
    """Whether the scene may stay: all that was made of it knows it by its hash, which says when it was written too."""
    try:
        # a scene of an earlier version does not say which files it was made from
        known = not call.settings.mesh.input_files or FILES in call.run.header("scene").notes
        return known and not Staleness(call.run, call.settings, call.base).reasons("mesh")
    except ArtefactError:  # it is damaged, and made anew
        return False
