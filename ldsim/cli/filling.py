"""What `ldsim mesh` does with a triangle surface: repair, fill, tell; or keep the tets that are there."""

from __future__ import annotations

import hashlib

import click

from ldsim.artefacts.records import read_scene
from ldsim.artefacts.store import file_hash
from ldsim.cli.stage import Run
from ldsim.errors import ArtefactError
from ldsim.mesh.formats import naming, read_surface
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.refine import refined
from ldsim.mesh.repair import repaired
from ldsim.mesh.tetrahedralize import Filling, filled, filled_with
from ldsim.mesh.triangles import Triangles
from ldsim.settings import SurfaceSettings, dump, resolve_path

Notes = dict[str, str | float]
POOR_RATIO = 0.05
LARGE_CHANGE = 0.05


def filled_surface(run: Run, settings: SurfaceSettings) -> tuple[Mesh, Notes]:
    """The tets of a surface, and what the header of scene.h5 says about them.

    Two runs of fTetWild never make the same tets. Those of a present scene.h5 are kept as long as the surface and all
    that shapes its tets stay the same, so that another density or pin does not bring another mesh.
    """
    path = resolve_path(settings.file, run.config)
    refine, scale = run.settings.mesh.refine, run.settings.mesh.scale
    identity = hashlib.sha256(f"{file_hash(path)} {scale} {refine} {dump(settings)}".encode()).hexdigest()
    kept = _kept(run, identity)
    if kept is not None:
        _tell(f"the tets of {run.path('scene')} are kept: the surface and its settings are the same")
        return kept
    surface = read_surface(path, scale)
    with naming(path):
        mended = repaired(surface)
        for repair in mended.repairs:
            _tell(f"{path.name}: {repair}")
        _tell(f"{path.name}: {len(mended.surface.faces)} triangles around {mended.surface.volume:.4g} m³, filling")
        filling = _filling(mended.surface, settings)
    notes = {f"surface_{name}": value for name, value in filling.quality().items()}
    _report(filling)
    mesh = filling.mesh
    for _ in range(refine):
        mesh = refined(mesh)
    return mesh, {"surface_identity": identity, "surface_repairs": "; ".join(mended.repairs) or "none", **notes}


def _filling(surface: Triangles, settings: SurfaceSettings) -> Filling:
    if settings.cells is not None:
        return filled_with(surface, settings.cells, settings.envelope, settings.timeout, _tell)
    assert settings.edge_length is not None
    return filled(surface, settings.edge_length, settings.envelope, settings.timeout)


def _report(filling: Filling) -> None:
    quality = filling.quality()
    _tell(
        f"{filling.mesh.n_cells} tets, radius ratio {quality['radius_ratio_min']:.3f} at worst and "
        f"{quality['radius_ratio_mean']:.3f} in the mean, volume {quality['volume']:.4g} m³ "
        f"({quality['volume_change']:+.2%} against the surface)"
    )
    if quality["radius_ratio_min"] < POOR_RATIO:
        _tell("warning: the worst tet is nearly flat, steps will take longer; try another mesh.surface.edge_length")
    if abs(quality["volume_change"]) > LARGE_CHANGE:
        _tell(
            "warning: the volume differs: where the surface crosses itself, what it encloses twice was counted twice; "
            "otherwise it has parts thinner than the envelope, and a smaller mesh.surface.envelope keeps them"
        )


def _kept(run: Run, identity: str) -> tuple[Mesh, Notes] | None:
    """The mesh of the present scene.h5 with its notes, if it was made from the same."""
    try:
        scene, header = read_scene(run.path("scene"))
    except ArtefactError:
        return None
    if header.notes.get("surface_identity") != identity:
        return None
    return scene.mesh, {name: value for name, value in header.notes.items() if name.startswith("surface_")}


def _tell(text: str) -> None:
    click.echo(text, err=True)
