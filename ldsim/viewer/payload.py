"""What the server says to the page: the solid and its bases once, then a few numbers a frame, little-endian.

A block is a JSON header of fixed length in front (uint32), padded to four bytes, and arrays one after the other.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.mechanics.quadrature import reference_points
from ldsim.simulator import Simulator

FRAME, FIELD = 1, 2
# The page draws no more grabs than this, and the server holds no more.
MAX_GRABS = 8


def block(header: Mapping[str, object], arrays: Mapping[str, NDArray[np.generic]]) -> bytes:
    """A header with the name, type and shape of every array, and the arrays."""
    layout = [{"name": name, "type": a.dtype.name, "shape": list(a.shape)} for name, a in arrays.items()]
    text = json.dumps({**header, "arrays": layout}).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays.values())


def solid_block(simulator: Simulator, header: Mapping[str, object]) -> bytes:
    """The surface at rest, and which of it is pinned: float32 positions, uint32 triangles."""
    surface = simulator.surface
    return block(
        header,
        {
            "rest": surface.rest.astype("<f4"),
            "triangles": surface.triangles.astype("<u4"),
            "pinned": simulator.scene.pinned[surface.vertices].astype("<u4"),
        },
    )


def space_block(simulator: Simulator) -> bytes:
    """A space: its basis on the surface (v, 3, k) and its cubature points with theirs, float32; no basis in full."""
    scene, surface, space = simulator.scene, simulator.surface, simulator.space
    header = {"space": space.name, "k": 0}
    if space.basis is None:
        return block(header, {})
    U, points = space.fields, space.rule.points
    shapes, _, _ = reference_points(scene.mesh.cell_type)
    share = shapes[points % len(shapes)]
    nodes = scene.points.nodes[points]
    return block(
        header | {"k": U.shape[2]},
        {
            "basis": U[surface.vertices].astype("<f4"),
            "point_rest": np.einsum("sa,sai->si", share, scene.mesh.vertices[nodes]).astype("<f4"),
            "point_basis": np.einsum("sa,saik->sik", share, U[nodes]).astype("<f4"),
        },
    )


class SpaceFrame(NamedTuple):
    """One space in a frame: coordinates (k,), or (3v,) in the full space, and the statistics of its last step.

    Attributes:
        distance: mean vertex distance to the full space beside it, metres; NaN where that is not shown.
        error: the sum of these over that of the full space's displacements, since the last start from rest.
    """

    coordinates: NDArray[np.float32]
    milliseconds: float
    iterations: float
    evaluations: float
    outcome: int
    troubled: int
    novelty: float
    distance: float
    error: float


@dataclass(frozen=True)
class GrabFrame:
    """One grab in a frame: its target (3,) and the centroid of what it holds in each space, metres."""

    id: int
    target: Array
    centroids: Sequence[Array]


def frame_bytes(
    number: int, seconds: float, rate: float, flags: int, spaces: Sequence[SpaceFrame], grabs: Sequence[GrabFrame]
) -> bytes:
    """A frame: 24 bytes, 36 and the coordinates a space, 16 and 12 a space for every grab.

    Args:
        rate: simulated seconds a second.
        flags: 1 paused, 2 recording, 4 replaying.
    """
    parts = [struct.pack("<BBBBIffII", FRAME, len(spaces), len(grabs), flags, number, seconds, rate, 0, 0)]
    for space in spaces:
        coordinates, *numbers = space
        q = np.ascontiguousarray(coordinates, dtype="<f4")
        parts.append(struct.pack("<IfffIIfff", len(q), *numbers))
        parts.append(q.tobytes())
    for grab in grabs:
        parts.append(struct.pack("<I", grab.id) + grab.target.astype("<f4").tobytes())
        parts += [centroid.astype("<f4").tobytes() for centroid in grab.centroids]
    return b"".join(parts)


def field_bytes(space: int, values: Array, low: float, high: float) -> bytes:
    """Colours of one space: 12 bytes and a byte a surface vertex, 0 at `low` to 255 at `high` and where not finite."""
    scaled = np.where(np.isfinite(values), np.clip((values - low) / max(high - low, 1e-300), 0, 1), 1) * 255
    return struct.pack("<BBHff", FIELD, space, 0, low, high) + scaled.astype(np.uint8).tobytes()
