"""Procedural meshes: boxes of voxels, cut into conforming tets or kept as hexes, and mapped to a shape."""

from __future__ import annotations

import functools
import inspect
import itertools
import math
from collections.abc import Callable
from typing import ParamSpec

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

Sizes = ParamSpec("Sizes")
SHAPES: dict[str, Callable[..., Mesh]] = {}


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


def _shape(make: Callable[Sizes, Mesh]) -> Callable[Sizes, Mesh]:
    """A shape that `SHAPES` knows by its name, made of sizes and a resolution that are allowed.

    Raises:
        MeshError: a size is not positive, or so are the sizes to each other; the resolution is out of range.
    """

    @functools.wraps(make)
    def checked(*args: Sizes.args, **options: Sizes.kwargs) -> Mesh:
        given = inspect.signature(make).bind(*args, **options).arguments
        resolution = given.pop("resolution", RESOLUTION)
        if resolution != int(resolution) or not 1 <= resolution <= MAX_RESOLUTION:
            raise MeshError(f"resolution is {resolution}; it must be a whole number from 1 to {MAX_RESOLUTION}")
        for name, size in given.items():
            if name != "cell_type" and not (math.isfinite(size) and size > 0):
                raise MeshError(f"{name} is {size} m; it must be positive")
        return make(*args, **options)

    SHAPES[make.__name__] = checked
    return checked


@_shape
def beam(
    length: float = 0.4, width: float = 0.1, height: float = 0.1, resolution: int = RESOLUTION, cell_type: str = "tet4"
) -> Mesh:
    """A straight beam, [0, length] × [−height/2, height/2] × [−width/2, width/2], metres.

    Args:
        resolution: voxels across the thinnest side; the others get as many as keep voxels near cubes.
    """
    sides = np.array([length, height, width])
    counts = np.rint(sides * resolution / sides.min())
    _check_count(float(counts.prod()))
    occupied = np.ones(counts.astype(int), dtype=bool)
    return _shifted(voxel_mesh(occupied, sides / counts, cell_type), [0.0, -height / 2, -width / 2])


@_shape
def mounted_bar(
    length: float = 0.4, thickness: float = 0.04, resolution: int = RESOLUTION, cell_type: str = "tet4"
) -> Mesh:
    """A square bar along x, from 0 on, that sticks out of a square plate three times as wide, metres.

    Args:
        length: of the bar; rounded to a multiple of its thickness. The plate, as thick as the bar, lies at x < 0.
        resolution: voxels across the bar.
    """
    blocks = np.zeros((_count_blocks(length, thickness, 1, 9) + 1, 3, 3), dtype=bool)
    blocks[0] = True
    blocks[:, 1, 1] = True
    return _shifted(
        _of_blocks(blocks, thickness, resolution, cell_type), [-thickness, -1.5 * thickness, -1.5 * thickness]
    )


@_shape
def cross(
    width: float = 0.22,
    height: float = 0.15,
    depth: float = 0.05,
    resolution: int = RESOLUTION,
    cell_type: str = "tet4",
) -> Mesh:
    """An X of two slanted bars that stands on two flat feet, centred at the origin, y up and thin in z, metres.

    A plus sign of voxels in the coordinates (p, q), arms two bars' widths long, is mapped by
    x = a (p − q), y = b (p (1 − s(|q|)) + q (1 − s(|p|))), where s rises smoothly from 0 at the middle to 1 at an
    arm's end, which makes the ends horizontal. On the plus the Jacobian is at least 0.86 ab.

    Args:
        width, height, depth: of the bounding box.
        resolution: voxels across a bar; 9 resolution³ voxels.
    """
    return _cross_with_arms(2, width, height, depth, resolution, cell_type)


@_shape
def slender_cross(
    width: float = 0.3,
    height: float = 0.26,
    depth: float = 0.025,
    resolution: int = RESOLUTION,
    cell_type: str = "tet4",
) -> Mesh:
    """An X as `cross`, with arms six bars' widths long, so that they bend far without much strain.

    Args:
        width, height, depth: of the bounding box.
        resolution: voxels across a bar; 25 resolution³ voxels.
    """
    return _cross_with_arms(6, width, height, depth, resolution, cell_type)


@_shape
def catapult(
    height: float = 0.3, thickness: float = 0.02, resolution: int = RESOLUTION, cell_type: str = "tet4"
) -> Mesh:
    """A thin upright arm on a square foot, with a bowl at its upper end that opens towards +x; y = 0 is the ground.

    In the manner of the paper's Figure 10: it bends far, nearly in a plane, so that two latent numbers may do.

    Args:
        height: of the whole; rounded to a multiple of the arm's thickness.
        thickness: of the arm, of the foot and of the bowl's walls; foot and bowl are five times as wide.
        resolution: voxels across the arm.
    """
    tall = _count_blocks(height, thickness, 7, 25)
    blocks = np.zeros((5, tall, 5), dtype=bool)
    blocks[:, 0] = True
    blocks[2, :, 2] = True
    blocks[2:4, -5:] = True
    blocks[3, -4:-1, 1:-1] = False
    return _shifted(_of_blocks(blocks, thickness, resolution, cell_type), [-2.5 * thickness, 0.0, -2.5 * thickness])


@_shape
def pendulum(
    length: float = 0.3, thickness: float = 0.02, resolution: int = RESOLUTION, cell_type: str = "tet4"
) -> Mesh:
    """A square rod that hangs from y = 0 down, with a cubic bob three times as thick at its end, metres.

    Args:
        length: of rod and bob together; rounded to whole voxels of thickness / resolution.
        resolution: voxels across the rod.
    """
    return _weighted_rod(length, thickness, resolution, cell_type, both_ends=False)


@_shape
def dumbbell(
    length: float = 0.3, thickness: float = 0.02, resolution: int = RESOLUTION, cell_type: str = "tet4"
) -> Mesh:
    """A square rod along y, from 0 down, with a cubic bob three times as thick at each end; see `pendulum`."""
    return _weighted_rod(length, thickness, resolution, cell_type, both_ends=True)


def _cross_with_arms(arms: int, width: float, height: float, depth: float, resolution: int, cell_type: str) -> Mesh:
    """The map of `cross` for arms of any length in bars' widths; its Jacobian grows with it."""
    bar = np.repeat([False, True, False], [arms * resolution, resolution, arms * resolution])
    plus = np.repeat((bar[:, None] | bar)[:, :, None], resolution, axis=2)
    _check_count((4.0 * arms + 1) * resolution**3)
    grid = voxel_mesh(plus, np.array([2, 2, 1]) / resolution, cell_type)
    end = 2 * arms + 1
    p, q, layer = grid.vertices.T - np.array([[end], [end], [0.5]])
    x = width / (2 * end + 2) * (p - q)
    y = height / (2 * end) * (p * (1 - _rise(np.abs(q), end)) + q * (1 - _rise(np.abs(p), end)))
    return Mesh(np.stack([x, y, depth * layer], axis=1), grid.cells, cell_type)


def _count_blocks(length: float, thickness: float, least: int, section: int) -> int:
    """How many cubes of the thickness make the length; each has up to `section` cubes beside it."""
    _check_count(section * length / thickness)
    count = round(length / thickness)
    if count < least:
        raise MeshError(
            f"length is {length:g} m; with thickness {thickness:g} m it must be {least * thickness:g} or more"
        )
    return count


def _of_blocks(blocks: NDArray[np.bool_], edge: float, resolution: int, cell_type: str) -> Mesh:
    """The mesh of a few cubes of the given edge, each of resolution³ voxels."""
    _check_count(float(blocks.size) * resolution**3)
    return voxel_mesh(np.kron(blocks, np.ones((resolution,) * 3, dtype=bool)), edge / resolution, cell_type)


def _weighted_rod(length: float, thickness: float, resolution: int, cell_type: str, both_ends: bool) -> Mesh:
    bob = 3 * resolution
    long = length * resolution / thickness
    _check_count(bob**2 * long)
    count = round(long)
    if count <= bob * (1 + both_ends):
        raise MeshError(f"length is {length:g} m; with thickness {thickness:g} m the bobs alone take as much or more")
    occupied = np.zeros((bob, count, bob), dtype=bool)
    occupied[resolution:-resolution, :, resolution:-resolution] = True
    occupied[:, :bob] = True
    if both_ends:
        occupied[:, -bob:] = True
    spacing = thickness / resolution
    return _shifted(voxel_mesh(occupied, spacing, cell_type), [-1.5 * thickness, -count * spacing, -1.5 * thickness])


def _rise(distance: Array, end: int) -> Array:
    """0 up to 1, then the cubic smooth step to 1 at the end."""
    t = np.clip((distance - 1) / (end - 1), 0, 1)
    return t * t * (3 - 2 * t)


def _shifted(mesh: Mesh, offset: list[float]) -> Mesh:
    return Mesh(mesh.vertices + offset, mesh.cells, mesh.cell_type)


def _check_count(voxels: float) -> None:
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
