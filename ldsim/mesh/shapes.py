"""Procedural meshes: boxes of voxels, cut into conforming tets or kept as hexes, and mapped to a shape."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldsim.arrays import Array
from ldsim.errors import MeshError, SettingsError
from ldsim.mesh.mesh import NODES_PER_CELL, Mesh
from ldsim.mesh.options import RESOLUTION, ShapeOptions

# Corners of a unit cube in VTK's order, and the same corners by their number x + 2y + 4z.
CUBE_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
VTK_CORNER = {int(corner @ [1, 2, 4]): i for i, corner in enumerate(CUBE_CORNERS)}
MAX_RESOLUTION = 64
MAX_VOXELS = 2_000_000


def _kuhn_tets() -> NDArray[np.int32]:
    """The six right-handed tets of a cube, (6, 4) corners: one for each monotone path from corner 0 to corner 6.

    All faces of the cube are cut along the diagonal from their lowest to their highest corner, so cubes side by side
    fit (Kuhn 1960, "Some combinatorial lemmas in topology").
    """
    tets = []
    for path in itertools.permutations((1, 2, 4)):
        a, b = VTK_CORNER[path[0]], VTK_CORNER[path[0] + path[1]]
        even = path in ((1, 2, 4), (2, 4, 1), (4, 1, 2))
        tets.append((0, a, b, 6) if even else (0, b, a, 6))
    return np.array(tets, dtype=np.int32)


CUBE_SPLITS = {"tet4": _kuhn_tets(), "hex8": np.arange(8, dtype=np.int32)[None]}


def voxel_mesh(occupied: NDArray[np.bool_], spacing: ArrayLike, cell_type: str = "tet4") -> Mesh:
    """The mesh of the occupied voxels of a grid whose lowest corner is the origin.

    Args:
        occupied: which voxels are solid, (nx, ny, nz) bool.
        spacing: edge lengths of a voxel, a number or (3,), metres.
        cell_type: "tet4" (six a voxel) or "hex8" (one a voxel).

    Raises:
        MeshError: nothing is occupied, or spacing or cell type are not allowed.
    """
    edges = np.broadcast_to(np.asarray(spacing, dtype=np.float64), 3)
    if cell_type not in NODES_PER_CELL:
        raise MeshError(f"cell type {cell_type!r} is not one of {', '.join(NODES_PER_CELL)}")
    if not (np.isfinite(edges).all() and (edges > 0).all()):
        raise MeshError(f"voxel spacing is {edges.tolist()} m; it must be positive")
    if occupied.ndim != 3 or not occupied.any():
        raise MeshError(
            f"voxels of shape {occupied.shape} have {int(occupied.sum())} occupied; expected 3-d, at least 1"
        )
    shape = tuple(size + 1 for size in occupied.shape)
    corners = np.argwhere(occupied)[:, None, :] + CUBE_CORNERS
    grid_index = np.ravel_multi_index(tuple(np.moveaxis(corners, -1, 0)), shape)
    used, cubes = np.unique(grid_index, return_inverse=True)
    cells = cubes.astype(np.int32).reshape(-1, 8)[:, CUBE_SPLITS[cell_type]].reshape(-1, NODES_PER_CELL[cell_type])
    vertices = np.stack(np.unravel_index(used, shape), axis=1) * edges
    return Mesh(vertices, cells, cell_type)


def beam(
    length: float = 0.4, width: float = 0.1, height: float = 0.1, resolution: int = RESOLUTION, cell_type: str = "tet4"
) -> Mesh:
    """A straight beam, [0, length] × [−height/2, height/2] × [−width/2, width/2], metres.

    Args:
        resolution: voxels across the thinnest side; the others get as many as keep voxels near cubes.

    Raises:
        MeshError: a side is not positive, or the resolution is out of range.
    """
    sides = np.array([length, height, width])
    if not (np.isfinite(sides).all() and (sides > 0).all()):
        raise MeshError(f"a beam of {length:g} × {height:g} × {width:g} m; each side must be positive")
    counts = np.rint(sides * resolution / sides.min())
    _check(resolution, float(counts.prod()))
    occupied = np.ones(counts.astype(int), dtype=bool)
    return _shifted(voxel_mesh(occupied, sides / counts, cell_type), [0.0, -height / 2, -width / 2])


def mounted_bar(resolution: int = RESOLUTION, cell_type: str = "tet4") -> Mesh:
    """A square bar of 0.4 m × (0.04 m)², along x from 0 on, that sticks out of a plate three times as wide at x < 0."""
    blocks = np.zeros((11, 3, 3), dtype=bool)
    blocks[0] = True
    blocks[:, 1, 1] = True
    return _of_blocks(blocks, 0.04, resolution, cell_type, [-0.04, -0.06, -0.06])


def cross(resolution: int = RESOLUTION, cell_type: str = "tet4") -> Mesh:
    """An X of two slanted bars on two flat feet, 0.22 × 0.15 × 0.05 m, centred at the origin, y up and thin in z.

    A plus sign of voxels in the coordinates (p, q), arms two bars' widths long, is mapped by
    x = a (p − q), y = b (p (1 − s(|q|)) + q (1 − s(|p|))), where s rises smoothly from 0 at the middle to 1 at an
    arm's end, which makes the ends horizontal. On the plus the Jacobian is at least 0.86 ab.
    """
    return _cross_with_arms(2, (0.22, 0.15, 0.05), resolution, cell_type)


def slender_cross(resolution: int = RESOLUTION, cell_type: str = "tet4") -> Mesh:
    """An X as `cross`, 0.3 × 0.26 × 0.025 m, with arms six bars' widths long: they bend far without much strain."""
    return _cross_with_arms(6, (0.3, 0.26, 0.025), resolution, cell_type)


def catapult(resolution: int = RESOLUTION, cell_type: str = "tet4") -> Mesh:
    """A thin upright arm on a square foot, with a bowl at its upper end that opens towards +x; y = 0 is the ground.

    In the manner of the paper's Figure 10, 0.3 m high, arm, foot and the bowl's walls 0.02 m thick: it bends far,
    nearly in a plane, so that two latent numbers may do.
    """
    blocks = np.zeros((5, 15, 5), dtype=bool)
    blocks[:, 0] = True
    blocks[2, :, 2] = True
    blocks[2:4, -5:] = True
    blocks[3, -4:-1, 1:-1] = False
    return _of_blocks(blocks, 0.02, resolution, cell_type, [-0.05, 0.0, -0.05])


def pendulum(resolution: int = RESOLUTION, cell_type: str = "tet4") -> Mesh:
    """A square rod, 0.02 m thick, that hangs from y = 0 down to −0.3 m, with a cubic bob three times as thick below."""
    return _weighted_rod(resolution, cell_type, both_ends=False)


def dumbbell(resolution: int = RESOLUTION, cell_type: str = "tet4") -> Mesh:
    """The rod of `pendulum` with a bob at each end."""
    return _weighted_rod(resolution, cell_type, both_ends=True)


SHAPES: dict[str, Callable[..., Mesh]] = {
    make.__name__: make for make in (beam, mounted_bar, cross, slender_cross, catapult, pendulum, dumbbell)
}


def _cross_with_arms(arms: int, size: tuple[float, float, float], resolution: int, cell_type: str) -> Mesh:
    """The map of `cross` for arms of any length in bars' widths; its Jacobian grows with it."""
    _check(resolution, (4.0 * arms + 1) * resolution**3)
    bar = np.repeat([False, True, False], [arms * resolution, resolution, arms * resolution])
    plus = np.repeat((bar[:, None] | bar)[:, :, None], resolution, axis=2)
    grid = voxel_mesh(plus, np.array([2, 2, 1]) / resolution, cell_type)
    end, (width, height, depth) = 2 * arms + 1, size
    p, q, layer = grid.vertices.T - np.array([[end], [end], [0.5]])
    x = width / (2 * end + 2) * (p - q)
    y = height / (2 * end) * (p * (1 - _rise(np.abs(q), end)) + q * (1 - _rise(np.abs(p), end)))
    return Mesh(np.stack([x, y, depth * layer], axis=1), grid.cells, cell_type)


def _weighted_rod(resolution: int, cell_type: str, both_ends: bool) -> Mesh:
    blocks = np.zeros((3, 15, 3), dtype=bool)
    blocks[1, :, 1] = True
    blocks[:, :3] = True
    blocks[:, -3:] |= both_ends
    return _of_blocks(blocks, 0.02, resolution, cell_type, [-0.03, -0.3, -0.03])


def _of_blocks(blocks: NDArray[np.bool_], edge: float, resolution: int, cell_type: str, corner: list[float]) -> Mesh:
    """The mesh of a few cubes of the given edge, each of resolution³ voxels, whose lowest corner is given."""
    _check(resolution, float(blocks.size) * resolution**3)
    voxels = np.kron(blocks, np.ones((resolution,) * 3, dtype=bool))
    return _shifted(voxel_mesh(voxels, edge / resolution, cell_type), corner)


def _rise(distance: Array, end: int) -> Array:
    """0 up to 1, then the cubic smooth step to 1 at the end."""
    t = np.clip((distance - 1) / (end - 1), 0, 1)
    return t * t * (3 - 2 * t)


def _shifted(mesh: Mesh, offset: list[float]) -> Mesh:
    return Mesh(mesh.vertices + offset, mesh.cells, mesh.cell_type)


def _check(resolution: int, voxels: float) -> None:
    if resolution != int(resolution) or not 1 <= resolution <= MAX_RESOLUTION:
        raise MeshError(f"resolution is {resolution}; it must be a whole number from 1 to {MAX_RESOLUTION}")
    if voxels > MAX_VOXELS:
        raise MeshError(f"the shape needs {voxels:.3g} voxels; allowed are {MAX_VOXELS}: lower the resolution")


def shaped(options: ShapeOptions) -> Mesh:
    """The mesh of a shape.

    Raises:
        SettingsError: no shape has the name.
    """
    if options.name not in SHAPES:
        raise SettingsError(f"mesh.shape.name is {options.name!r}; known are {', '.join(SHAPES)}")
    return SHAPES[options.name](resolution=options.resolution, cell_type=options.cell_type)
