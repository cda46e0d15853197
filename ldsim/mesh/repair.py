"""Dirty surfaces: what can be mended without guessing is mended and told, the rest is refused in one line."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ldsim.arrays import Indices
from ldsim.errors import MeshError
from ldsim.mesh.mesh import MERGE_DISTANCE
from ldsim.mesh.triangles import Triangles, face_volumes, winding_number

MAX_HOLE = 0.1  # of the diagonal
MIN_VOLUME = 1e-9  # of the diagonal cubed


@dataclass(frozen=True, eq=False)
class Repaired:
    """A closed surface of consistently outward triangles.

    Attributes:
        surface: each edge belongs to two triangles. It may still cross itself.
        repairs: what was done to get there, a phrase each.
    """

    surface: Triangles
    repairs: tuple[str, ...]


def repaired(surface: Triangles) -> Repaired:
    """Merge vertices, drop what is superfluous, orient, fill small holes; in this order.

    A component inside another one keeps the direction it has relative to it, so that a cavity stays one.

    Raises:
        MeshError: an edge has three triangles or more, the surface has one side only (a Möbius strip), a hole is
            larger than `MAX_HOLE` times the diagonal, or nothing is enclosed.
    """
    repairs: list[str] = []
    surface = _merged(surface, repairs)
    surface = _without_superfluous(surface, repairs)
    _check_manifold(surface)
    surface = _consistent(surface, repairs)
    surface = _filled(surface, repairs)
    _check_manifold(surface)
    return Repaired(_outward(surface, repairs), tuple(repairs))


def _merged(surface: Triangles, repairs: list[str]) -> Triangles:
    vertices, index = np.unique(surface.vertices, axis=0, return_inverse=True)
    pairs = cKDTree(vertices).query_pairs(MERGE_DISTANCE * surface.diagonal, output_type="ndarray")
    group = _components(len(vertices), pairs)
    _, first = np.unique(group, return_index=True)
    faces = group[index.reshape(-1)][surface.faces]
    used = np.zeros(len(first), dtype=bool)
    used[faces] = True
    referenced = len(np.unique(surface.faces))
    _tell(repairs, len(surface.vertices) - referenced, "vertices that no triangle uses dropped")
    _tell(repairs, referenced - int(used.sum()), "duplicate vertices merged")
    return Triangles(vertices[first[used]], (np.cumsum(used) - 1)[faces])


def _without_superfluous(surface: Triangles, repairs: list[str]) -> Triangles:
    corners = np.sort(surface.faces, axis=1)
    proper = (corners[:, 0] < corners[:, 1]) & (corners[:, 1] < corners[:, 2])
    _, first = np.unique(corners, axis=0, return_index=True)
    kept = np.zeros(len(corners), dtype=bool)
    kept[first] = True
    _tell(repairs, int((~proper).sum()), "triangles without area dropped")
    _tell(repairs, int((proper & ~kept).sum()), "triangles that are there twice dropped")
    if not (proper & kept).any():
        raise MeshError("the surface has no triangle of three different vertices; is mesh.scale right?")
    return Triangles(surface.vertices, surface.faces[proper & kept])


def _check_manifold(surface: Triangles) -> None:
    edges, counts = np.unique(np.sort(_half_edges(surface), axis=1), axis=0, return_counts=True)
    crowded = np.flatnonzero(counts > 2)
    if len(crowded):
        place = surface.vertices[edges[crowded[0]]].mean(axis=0)
        raise MeshError(
            f"the surface is not manifold: {len(crowded)} of its edges belong to more than two triangles, the first "
            f"near ({place[0]:.4g}, {place[1]:.4g}, {place[2]:.4g}) m; each edge must have two. Separate or join the "
            "parts that touch there in a mesh editor"
        )


def _consistent(surface: Triangles, repairs: list[str]) -> Triangles:
    """Neighbours turn the same way, as most triangles of their component do.

    Each triangle is two nodes of a graph, as it is and turned over; neighbours that agree join like with like. A
    component of which both sides are connected has one side only.
    """
    first, second, agree = _neighbours(surface)
    count = len(surface.faces)
    turned = np.where(agree, 0, count)
    pairs = np.concatenate(
        [np.stack([first, second + turned], axis=1), np.stack([first + count, second + count - turned], axis=1)]
    )
    labels = _components(2 * count, pairs)
    as_is, over = labels[:count], labels[count:]
    if (as_is == over).any():
        raise MeshError("the surface has one side only, like a Möbius strip; it encloses nothing that could be filled")
    votes = np.bincount(as_is, minlength=2 * count)
    turn = (votes[as_is] < votes[over]) | ((votes[as_is] == votes[over]) & (as_is > over))
    _tell(repairs, int(turn.sum()), "triangles turned to agree with their neighbours")
    return Triangles(surface.vertices, _turned_over(surface.faces, turn))


def _filled(surface: Triangles, repairs: list[str]) -> Triangles:
    """Every hole closed by a fan around its middle.

    Raises:
        MeshError: a hole is too large to guess what was there.
    """
    vertices, faces = [surface.vertices], [surface.faces]
    count = len(surface.vertices)
    loops = _hole_loops(surface)
    for loop in loops:
        rim = surface.vertices[loop]
        across = float(np.linalg.norm(np.ptp(rim, axis=0)))
        if across > MAX_HOLE * surface.diagonal:
            middle = rim.mean(axis=0)
            raise MeshError(
                f"the surface is open: {len(loops)} holes, one of them {across:.3g} m across near ({middle[0]:.4g}, "
                f"{middle[1]:.4g}, {middle[2]:.4g}) m; filled are holes up to {MAX_HOLE * surface.diagonal:.3g} m "
                f"({MAX_HOLE:.0%} of the diagonal). Close it in a mesh editor"
            )
        if len(loop) == 3:
            faces.append(loop[None])
        else:
            vertices.append(rim.mean(axis=0)[None])
            faces.append(np.stack([loop, np.roll(loop, -1), np.full(len(loop), count)], axis=1))
            count += 1
    _tell(repairs, len(loops), "holes filled")
    return Triangles(np.concatenate(vertices), np.concatenate(faces))


def _hole_loops(surface: Triangles) -> list[Indices]:
    """The vertices around each hole, in the direction in which the triangles that fill it run."""
    halves = _half_edges(surface)
    key = halves.min(axis=1) * len(surface.vertices) + halves.max(axis=1)
    _, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)
    after: defaultdict[int, list[int]] = defaultdict(list)
    for end, start in halves[counts[inverse] == 1].tolist():
        after[start].append(end)
    loops: list[Indices] = []
    for start in list(after):
        while after[start]:
            loop = [start]
            while (vertex := after[loop[-1]].pop()) != start:
                loop.append(vertex)
            loops.append(np.array(loop, dtype=np.int64))
    return loops


def _outward(surface: Triangles, repairs: list[str]) -> Triangles:
    """The components that lie in no other one look outward; those inside turn with them."""
    first, second, _ = _neighbours(surface)
    component = _components(len(surface.faces), np.stack([first, second], axis=1))
    parts = [Triangles(surface.vertices, surface.faces[component == i]) for i in range(component.max() + 1)]
    volumes = np.bincount(component, weights=face_volumes(surface))
    # boxes first, all at once: a scan may have thousands of crumbs
    points = np.array([part.vertices[part.faces[0, 0]] for part in parts])
    low, high = (np.array([end(p.vertices[p.faces], axis=(0, 1)) for p in parts]) for end in (np.min, np.max))
    around: list[list[int]] = []
    for i, point in enumerate(points):
        near = np.flatnonzero(((point >= low) & (point <= high)).all(axis=1))
        around.append([int(j) for j in near if j != i and abs(winding_number(parts[j], point)) > 0.5])
    inverted = {i for i, outer in enumerate(around) if not outer and volumes[i] < 0}
    turn = np.array([bool(inverted & {i, *outer}) for i, outer in enumerate(around)])
    _tell(repairs, int(turn.sum()), "inside-out components turned")
    turned = Triangles(surface.vertices, _turned_over(surface.faces, turn[component]))
    if turned.volume <= MIN_VOLUME * surface.diagonal**3:
        raise MeshError(
            f"the surface encloses {turned.volume:.3g} m³ with a diagonal of {surface.diagonal:.3g} m; there is no "
            "solid to fill"
        )
    return turned


def _half_edges(surface: Triangles) -> Indices:
    """The directed edges of all triangles, (3f, 2): first those from corner 0 to 1, then 1 to 2, then 2 to 0."""
    return np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]])


def _neighbours(surface: Triangles) -> tuple[Indices, Indices, NDArray[np.bool_]]:
    """The two triangles of each edge that has two, and whether they run along it in opposite directions."""
    halves = _half_edges(surface)
    key = halves.min(axis=1) * len(surface.vertices) + halves.max(axis=1)
    order = np.argsort(key, kind="stable")
    twin = np.flatnonzero(key[order][1:] == key[order][:-1])
    first, second = order[twin], order[twin + 1]
    count = len(surface.faces)
    return first % count, second % count, halves[first, 0] != halves[second, 0]


def _components(count: int, pairs: Indices) -> Indices:
    """The connected component of each of `count` nodes, numbered from 0."""
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _turned_over(faces: Indices, turn: NDArray[np.bool_]) -> Indices:
    turned = faces.copy()
    turned[turn] = turned[turn][:, [0, 2, 1]]
    return turned


def _tell(repairs: list[str], count: int, what: str) -> None:
    if count:
        repairs.append(f"{count} {what}")
