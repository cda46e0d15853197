"""A closed triangle surface filled with tets by fTetWild (Hu et al. 2020, "Fast tetrahedral meshing in the wild")."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.errors import MeshError
from ldsim.mesh.mesh import Mesh, corner_volumes, reoriented, without_unused_vertices
from ldsim.mesh.triangles import Triangles

ENVELOPE = 1 / 20  # of the edge length
LONGEST_EDGE = 1 / 3  # of the diagonal
TRIES = 5
CLOSE_ENOUGH = 0.1


@dataclass(frozen=True, eq=False)
class Tetrahedralization:
    """Tets in place of a surface.

    Attributes:
        mesh: right-handed tets. Another call makes other ones: fTetWild is not deterministic.
        edge_length: the target that they were made with, metres.
        surface_volume: what the surface encloses, m³.
    """

    mesh: Mesh
    edge_length: float
    surface_volume: float

    def quality(self) -> dict[str, float]:
        """What tells a good mesh from a bad one, by name."""
        ratios = radius_ratios(self.mesh)
        volume = float(corner_volumes(self.mesh).sum())
        return {
            "edge_length": self.edge_length,
            "radius_ratio_min": float(ratios.min()),
            "radius_ratio_mean": float(ratios.mean()),
            "volume": volume,
            "volume_change": volume / self.surface_volume - 1,
        }


def tetrahedralized(
    surface: Triangles, edge_length: float, envelope: float | None = None, seconds: float = 600.0
) -> Tetrahedralization:
    """Tets of about the given edge length.

    Args:
        surface: closed and outward, as `repair.repaired` returns it; it may cross itself.
        edge_length: metres; tets are smaller where the surface needs it, and jump in number as it changes.
        envelope: how far the tets' surface may be from the given one, metres; an edge length's twentieth by default.
        seconds: after which fTetWild is stopped.

    Raises:
        MeshError: pytetwild is not installed; fTetWild took longer, crashed, or returned no tets.
    """
    if importlib.util.find_spec("pytetwild") is None:
        raise MeshError(
            "a surface is filled with tets by pytetwild, which is not installed; in ldsim's folder run: "
            f"{sys.executable} -m pip install '.[surface]'"
        )
    if not 0 < edge_length <= surface.diagonal * LONGEST_EDGE:
        raise MeshError(
            f"the edge length is {edge_length:.3g} m; with a diagonal of {surface.diagonal:.3g} m it must be positive "
            f"and at most {surface.diagonal * LONGEST_EDGE:.3g} m (are mesh.surface.edge_length and mesh.scale right?)"
        )
    with tempfile.TemporaryDirectory(prefix="ldsim-") as folder:
        source, target = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(
            source,
            vertices=surface.vertices,
            faces=surface.faces,
            edge_length=edge_length,
            envelope=envelope or ENVELOPE * edge_length,
        )
        _run_ftetwild(source, target, seconds)
        with np.load(target) as made:
            vertices, cells = made["vertices"], made["cells"]
    if len(cells) == 0:
        raise MeshError("fTetWild found nothing inside the surface; give a smaller mesh.surface.edge_length")
    mesh = without_unused_vertices(reoriented(Mesh(vertices, cells.astype(np.int32), "tet4")))
    return Tetrahedralization(mesh, edge_length, surface.volume)


def tetrahedralized_to_count(
    surface: Triangles,
    cells: int,
    envelope: float | None = None,
    seconds: float = 600.0,
    tell: Callable[[str], None] = lambda text: None,
) -> Tetrahedralization:
    """About as many tets as asked for: the edge length follows from some tries, each told in words.

    The first is that of regular tets of the right volume, l³ = 6√2 V / cells; the next ones follow the number got.

    Raises:
        MeshError: as `tetrahedralized` in the first try; where a later one fails, those before it count.
    """
    length = float((6 * np.sqrt(2) * surface.volume / cells) ** (1 / 3))
    tried: list[Tetrahedralization] = []
    while len(tried) < TRIES:
        length = min(length, surface.diagonal * LONGEST_EDGE)
        if tried and length == tried[-1].edge_length:  # no longer edge is allowed, and the filling would be the same
            break
        try:
            tried.append(tetrahedralized(surface, length, envelope, seconds))
        except MeshError as error:
            if not tried:
                raise
            tell(f"the next edge length, {1e3 * length:.3g} mm: {error}; the nearest of the tries before is taken")
            break
        length, got = tried[-1].edge_length, tried[-1].mesh.n_cells
        tell(
            f"try {len(tried)} of at most {TRIES}: edge length {1e3 * length:.3g} mm, {got} tets, of {cells} asked for"
        )
        if abs(got / cells - 1) <= CLOSE_ENOUGH:
            break
        length *= float((got / cells) ** (1 / _order(tried[-2:])))
    return min(tried, key=lambda made: abs(np.log(made.mesh.n_cells / cells)))


def _order(tried: Sequence[Tetrahedralization]) -> float:
    """The power of 1 / edge length with which cells grow: 3 in the bulk, less where the surface dictates them."""
    if len(tried) < 2 or tried[0].edge_length == tried[1].edge_length:
        return 3.0
    first, second = tried
    growth = np.log(first.mesh.n_cells / second.mesh.n_cells) / np.log(second.edge_length / first.edge_length)
    return float(np.clip(growth, 1.0, 3.0))


def _run_ftetwild(source: Path, target: Path, seconds: float) -> None:
    """Fill in a process of its own, whose folder is the temporary one: fTetWild leaves a file where it runs."""
    try:
        done = subprocess.run(
            [sys.executable, "-m", "ldsim.mesh.ftetwild", str(source), str(target)],
            cwd=source.parent,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
            capture_output=True,
            check=False,
            timeout=seconds,
        )
    except subprocess.TimeoutExpired as error:
        raise MeshError(
            f"fTetWild did not fill the surface within {seconds:g} s; give a larger mesh.surface.edge_length, envelope "
            "or timeout"
        ) from error
    if done.returncode or not target.is_file():
        words = done.stderr.decode(errors="replace").strip().splitlines()
        raise MeshError(
            f"fTetWild failed on the surface with status {done.returncode} ({words[-1] if words else 'no message'}); "
            "give another mesh.surface.edge_length or clean the surface in a mesh editor"
        )


def radius_ratios(mesh: Mesh) -> Array:
    """Three times the inscribed by the circumscribed sphere's radius, (m,): 1 for a regular tet, 0 for a flat one.

    With edges a, b, c from one corner, volume V and surface S: r = 3V/S, and R = |a²(b×c) + b²(c×a) + c²(a×b)| / 12V.

    Raises:
        MeshError: the cells are no tets.
    """
    if mesh.cell_type != "tet4":
        raise MeshError(f"cells are {mesh.cell_type}; radius ratios are those of tet4")
    volume = np.abs(corner_volumes(mesh)[:, 0])
    x = mesh.vertices[mesh.cells]
    a, b, c = np.moveaxis(x[:, 1:] - x[:, :1], 1, 0)
    normals = np.stack([np.cross(a, b), np.cross(b, c), np.cross(c, a), np.cross(b - a, c - a)])
    surface = np.linalg.norm(normals, axis=2).sum(axis=0) / 2
    aa, bb, cc = ((edge * edge).sum(axis=1)[:, None] for edge in (a, b, c))
    apex = np.linalg.norm(aa * np.cross(b, c) + bb * np.cross(c, a) + cc * np.cross(a, b), axis=1)
    ratios: Array = np.divide(108 * volume**2, surface * apex, out=np.zeros_like(apex), where=apex > 0)
    return ratios
