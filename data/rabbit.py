"""Makes data/rabbit.stl: a rabbit of round blobs, as the level set of a sum of bell curves, in millimetres.

`python data/rabbit.py` writes it. The level set is turned into quadrilaterals by surface nets (Gibson 1998,
"Constrained elastic surface nets"): a vertex in each cell of a grid that the surface crosses, at the mean of its edges'
crossings, and a face across each edge of the grid with ends on different sides.
"""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SPACING = 6.5
SHARPNESS = 4.0  # of the seams between blobs
# Centre and radii of each blob, mm; y is up, and the rabbit sits on y = 0.
BLOBS = np.array(
    [
        [0, 26, 0, 30, 30, 34],  # body
        [0, 66, 14, 20, 20, 22],  # head
        [-10, 104, 8, 8, 28, 8],  # ears
        [10, 104, 8, 8, 28, 8],
        [-16, 8, 26, 13, 12, 20],  # feet
        [16, 8, 26, 13, 12, 20],
        [0, 24, -36, 13, 13, 13],  # tail
    ]
)


def height(points: Array) -> Array:
    """Positive inside the rabbit, (…,) of points (…, 3)."""
    offset = (points[..., None, :] - BLOBS[:, :3]) / BLOBS[:, 3:]
    inside = np.log(np.exp(SHARPNESS * (1 - (offset**2).sum(axis=-1))).sum(axis=-1))
    return np.minimum(inside, points[..., 1] / 5)


def surface_net(values: Array) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (v, 3) in units of the grid and triangles (t, 3), outward, around the positive values."""
    total, count = np.zeros((*(n - 1 for n in values.shape), 3)), np.zeros([n - 1 for n in values.shape])
    quads = []
    cell = np.arange(count.size).reshape(count.shape)
    for axis in range(3):
        first, second = np.moveaxis(values, axis, 0)[:-1], np.moveaxis(values, axis, 0)[1:]
        crossed = np.moveaxis((first > 0) != (second > 0), 0, axis)
        for place in np.argwhere(crossed):
            ends = place, place + np.eye(3, dtype=int)[axis]
            low, high = values[tuple(ends[0])], values[tuple(ends[1])]
            crossing = place + np.eye(3)[axis] * low / (low - high)
            b, c = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
            around = [tuple(place - b - c), tuple(place - c), tuple(place), tuple(place - b)]
            for corner in around:
                total[corner] += crossing
                count[corner] += 1
            quad = [cell[corner] for corner in around]
            quads.append(quad if low > 0 else quad[::-1])
    used = np.flatnonzero(count)
    faces = np.searchsorted(used, np.array(quads))[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    return (total / np.maximum(count, 1)[..., None]).reshape(-1, 3)[used], faces


def main() -> None:
    low, high = np.array([-50, -10, -70]), np.array([50, 150, 70])
    axes = [np.arange(a, b + SPACING, SPACING) for a, b in zip(low, high, strict=True)]
    values = height(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) + 1e-3)
    vertices, faces = surface_net(values)
    path = Path(__file__).with_name("rabbit.stl")
    meshio.Mesh((vertices * SPACING + low).astype(np.float32), [("triangle", faces)]).write(path, binary=True)


if __name__ == "__main__":
    main()
