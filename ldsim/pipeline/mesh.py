"""The stage mesh: a mesh or surface file, or a shape → the scene."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.artefacts.records import read_scene, write_scene
from ldsim.errors import ArtefactError, SettingsError
from ldsim.mechanics.dead_loads import load_force
from ldsim.mechanics.pins import pinned_vertices
from ldsim.mechanics.properties import Properties
from ldsim.mechanics.scene import Scene, make_scene
from ldsim.mesh.formats import naming, read_mesh, read_surface
from ldsim.mesh.mesh import Mesh, check_cells, doubled_vertices, doubled_words, reoriented
from ldsim.mesh.options import SurfaceOptions
from ldsim.mesh.refine import CHILDREN, refined
from ldsim.mesh.repair import repaired
from ldsim.mesh.shapes import shaped
from ldsim.mesh.tetrahedralize import tetrahedralized, tetrahedralized_to_count
from ldsim.pipeline.files import content_hash, file_sums, resolve_path
from ldsim.pipeline.options import MeshOptions
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.run import Run

Numbers = Mapping[str, Array]
# A mesh, and what the header of scene.h5 says of the surface that it was made from.
Tets = tuple[Mesh, dict[str, str | float]]
Tell = Callable[[str], None]
IDENTITY = "surface_identity"
POOR_RATIO = 0.05
LARGE_CHANGE = 0.05


def mesh(run: Run, options: MeshOptions, progress: Progress = SILENT, base: Path = Path()) -> Scene:
    """Read or make the mesh of a run, and write scene.h5.

    Two runs of fTetWild never make the same tets. Those of a present scene.h5 are kept as long as the surface and all
    that shapes its tets stay the same, so that another density or pin does not bring another mesh.

    Args:
        base: the folder to which the files of the options are relative.

    Raises:
        MeshError: the mesh cannot be read, made or simulated.
        SceneError: material, pins or loads do not fit the mesh.
        SettingsError: a file or a shape that is not there.
    """
    stage, files = run.stage("mesh", options), file_sums(options.input_files, base)
    scene, notes = described_scene(options, progress, base, kept=run.path("scene"))
    write_scene(run.path("scene"), stage.header("scene", (), -1, files=files, **notes), scene)
    run.written("scene")
    return scene


def described_scene(
    options: MeshOptions, progress: Progress, base: Path, kept: Path | None = None
) -> tuple[Scene, dict[str, str | float]]:
    """The scene of the options, and what the header of its artefact says of its surface.

    Args:
        kept: an artefact whose tets are taken if they are of the same surface.
    """
    cell_data: Numbers = {}
    if options.surface is not None:
        made, notes = _of_surface(options, progress, base, kept)
    else:
        (made, cell_data), notes = _volume(options, progress, base), {}
    check_cells(made)  # before anything is integrated over them
    pinned = pinned_vertices(made, options.pins)
    properties = _properties(options, made, cell_data)
    forces = [load_force(made, properties.density, load) for load in options.loads]
    load = sum(forces[1:], start=forces[0]) if forces else None
    scene = make_scene(made, pinned, properties, options.gravity, options.time_step, load)
    if doubled := doubled_vertices(made):
        progress.tell(f"warning: {doubled_words(doubled)}")
    return scene, notes


def _of_surface(options: MeshOptions, progress: Progress, base: Path, kept: Path | None) -> Tets:
    assert options.surface is not None
    path = resolve_path(options.surface.file, base)
    identity = surface_identity(path, options.surface, options.scale, options.refine)
    found = None if kept is None else _kept(kept, identity)
    if found is not None:
        progress.tell(f"the tets of {kept} are kept: the surface and its settings are the same")
        return found
    made, notes = tets_of_surface(path, options.surface, options.scale, progress.tell)
    for _ in range(options.refine):
        made = refined(made)
    return made, {IDENTITY: identity, **notes}


def _kept(path: Path, identity: str) -> Tets | None:
    """The mesh of a scene.h5 with its notes, if it was made from the same."""
    try:
        scene, header = read_scene(path)
    except ArtefactError:
        return None
    if header.notes.get(IDENTITY) != identity:
        return None
    return scene.mesh, {name: value for name, value in header.notes.items() if name.startswith("surface_")}


def _volume(options: MeshOptions, progress: Progress, base: Path) -> tuple[Mesh, Numbers]:
    """The mesh of a shape or a file, and the numbers that the file gives to each cell."""
    cell_data: Numbers = {}
    if options.shape is not None:
        made = shaped(options.shape)
    else:
        assert options.file is not None
        read = read_mesh(resolve_path(options.file, base), options.scale)
        if read.dropped_vertices:
            progress.tell(f"{read.dropped_vertices} vertices that no cell uses were dropped")
        made, cell_data = reoriented(read.mesh) if options.reorient else read.mesh, read.cell_data
    for _ in range(options.refine):
        made = refined(made)
        cell_data = {name: np.repeat(values, CHILDREN) for name, values in cell_data.items()}
    return made, cell_data


def _properties(options: MeshOptions, made: Mesh, cell_data: Numbers) -> Properties:
    """The scene's material, then what the file says of each cell, then the regions in their order."""
    material, names = options.material, options.cell_data
    properties = Properties.uniform(
        made.n_cells, material.model, material.youngs_modulus, material.poisson_ratio, options.density
    )
    if names is not None:
        modulus, ratio = _column(names.youngs_modulus, cell_data), _column(names.poisson_ratio, cell_data)
        density = _column(names.density, cell_data)
        properties = properties.changed(youngs_modulus=modulus, poisson_ratio=ratio, density=density)
    for region in options.regions:
        cells = region.where.cells_in(made, "changes")
        properties = properties.changed(cells, density=region.density, **region.material.model_dump())
    return properties


def _column(name: str | None, cell_data: Numbers) -> Array | None:
    if name is None:
        return None
    if name not in cell_data:
        known = ", ".join(cell_data) or "none"
        raise SettingsError(f"mesh.cell_data: the mesh file gives no number {name!r} to its cells; known are {known}")
    return cell_data[name]


def surface_identity(path: Path, options: SurfaceOptions, scale: float, refine: int) -> str:
    """SHA-256 of all that shapes the tets of a surface; not of how its file is called, nor of how long it may take."""
    shaping = options.model_copy(update={"file": "", "timeout": 0.0}).dump()
    return hashlib.sha256(f"{content_hash(path)} {scale} {refine} {shaping}".encode()).hexdigest()


def tets_of_surface(path: Path, options: SurfaceOptions, scale: float, tell: Tell) -> Tets:
    """The tets of a surface file, its repairs and their quality.

    Raises:
        MeshError: the surface cannot be read, repaired or filled.
    """
    surface = read_surface(path, scale)
    with naming(path):
        mended = repaired(surface)
        for repair in mended.repairs:
            tell(f"{path.name}: {repair}")
        volume = f"{mended.surface.volume:.4g} m³"
        tell(f"{path.name}: {len(mended.surface.faces)} triangles around {volume} are filled with tets")
        limits = (options.envelope, options.timeout)
        if options.edge_length is not None:
            found = tetrahedralized(mended.surface, options.edge_length, *limits)
        else:
            assert options.cells is not None
            found = tetrahedralized_to_count(mended.surface, options.cells, *limits, tell)
    quality = found.quality()
    _tell_quality(found.mesh.n_cells, quality, tell)
    notes = {f"surface_{name}": value for name, value in quality.items()}
    return found.mesh, {"surface_repairs": "; ".join(mended.repairs) or "none", **notes}


def _tell_quality(cells: int, quality: dict[str, float], tell: Tell) -> None:
    tell(
        f"{cells} tets are taken: radius ratio {quality['radius_ratio_min']:.2f} at worst and "
        f"{quality['radius_ratio_mean']:.2f} on average (1: regular, 0: flat), volume {quality['volume']:.4g} m³ "
        f"({quality['volume_change']:+.2%} against the surface)"
    )
    if quality["radius_ratio_min"] < POOR_RATIO:
        tell("warning: the worst tet is nearly flat, steps will take longer; try another mesh.surface.edge_length")
    if abs(quality["volume_change"]) > LARGE_CHANGE:
        tell(
            "warning: the volume differs: where the surface crosses itself, what it encloses twice was counted twice; "
            "otherwise it is thinner than the envelope in places, and a smaller mesh.surface.envelope keeps them"
        )
