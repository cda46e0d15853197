"""A triangle surface becomes tets: repaired, filled, and told how good they are."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from ldsim.artefacts.store import file_hash
from ldsim.mesh.formats import naming, read_surface
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.options import SurfaceOptions
from ldsim.mesh.repair import repaired
from ldsim.mesh.tetrahedralize import tetrahedralized, tetrahedralized_to_count

# A mesh, and what the header of scene.h5 says of the surface that it was made from.
Tets = tuple[Mesh, dict[str, str | float]]
Tell = Callable[[str], None]

IDENTITY = "surface_identity"
POOR_RATIO = 0.05
LARGE_CHANGE = 0.05


def surface_identity(path: Path, options: SurfaceOptions, scale: float, refine: int) -> str:
    """SHA-256 of all that shapes the tets of a surface."""
    return hashlib.sha256(f"{file_hash(path)} {scale} {refine} {options.dump()}".encode()).hexdigest()


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
        tell(f"{path.name}: {len(mended.surface.faces)} triangles around {mended.surface.volume:.4g} m³, meshing")
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
        f"{cells} tets, radius ratio {quality['radius_ratio_min']:.3f} at worst and "
        f"{quality['radius_ratio_mean']:.3f} in the mean, volume {quality['volume']:.4g} m³ "
        f"({quality['volume_change']:+.2%} against the surface)"
    )
    if quality["radius_ratio_min"] < POOR_RATIO:
        tell("warning: the worst tet is nearly flat, steps will take longer; try another mesh.surface.edge_length")
    if abs(quality["volume_change"]) > LARGE_CHANGE:
        tell(
            "warning: the volume differs: where the surface crosses itself, what it encloses twice was counted twice; "
            "otherwise it is thinner than the envelope in places, and a smaller mesh.surface.envelope keeps them"
        )
