"""glTF 2.0 binary: the basis as morph targets, the coordinates as an animation of their weights (Khronos, glTF 2.0).

A vertex is v + Σ w_j t_j in any viewer. With t_j = a_j U_j, w_j = q_j / a_j and a_j = max |q_j| over the motion, that
is v + U q with weights in −1 … 1. Normals follow to first order: each target carries the derivative of the normals.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ldsim.arrays import Array
from ldsim.export.playback import Playback
from ldsim.mesh.surface import Surface
from ldsim.report.camera import upright
from ldsim.report.drawing import CLAY

COMPONENT = {"f4": 5126, "u4": 5125}
SHAPE = {(): "SCALAR", (3,): "VEC3"}
VERTEX_BUFFER, INDEX_BUFFER = 34962, 34963
MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942


@dataclass
class _Buffer:
    """The binary chunk as it grows, with the views and accessors into it."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, int]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add(self, values: NDArray[np.generic], target: int | None = None, bounds: bool = False) -> int:
        """Append (count,) or (count, 3) float32 or uint32 values; returns the accessor's number."""
        little = np.ascontiguousarray(values)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": little.nbytes}
        self.views.append(view if target is None else view | {"target": target})
        self.data += little.tobytes()
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": COMPONENT[little.dtype.str[1:]],
            "count": len(little),
            "type": SHAPE[little.shape[1:]],
        }
        if bounds:
            rows = little.reshape(len(little), -1)
            accessor["min"], accessor["max"] = rows.min(axis=0).tolist(), rows.max(axis=0).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def write_glb(playback: Playback, path: Path) -> None:
    """Write the surface with its morph targets and their animation, float32, metres and seconds.

    Raises:
        ExportError: the motion is of the full space, which has no basis.
    """
    U, coordinates = playback.reduced("glTF")
    surface = Surface.of(playback.mesh)
    rest = playback.mesh.vertices[surface.vertices]
    reach = np.abs(coordinates).max(axis=0)
    reach[reach == 0] = 1.0
    modes = U.reshape(playback.mesh.n_vertices, 3, -1)[surface.vertices] * reach
    buffer = _Buffer()
    primitive = _primitive(buffer, rest, surface.triangles, modes)
    weights = (coordinates / reach).astype("<f4").ravel()
    times = np.array([playback.time(frame) for frame in range(playback.frames)], dtype="<f4")
    sampler = {"input": buffer.add(times, bounds=True), "output": buffer.add(weights), "interpolation": "LINEAR"}
    _write_chunks(path, _document(playback, buffer, primitive, sampler), bytes(buffer.data))


def _primitive(buffer: _Buffer, rest: Array, triangles: NDArray[np.int32], modes: Array) -> dict[str, Any]:
    """The surface (v, 3) with one morph target a mode, (v, 3, k)."""
    normals = vertex_normals(rest, triangles)
    attributes = {
        "POSITION": buffer.add(rest.astype("<f4"), VERTEX_BUFFER, bounds=True),
        "NORMAL": buffer.add(normals.astype("<f4"), VERTEX_BUFFER),
    }
    fields = [(modes[:, :, j], normal_derivative(rest, triangles, modes[:, :, j])) for j in range(modes.shape[2])]
    targets = [
        {
            "POSITION": buffer.add(mode.astype("<f4"), VERTEX_BUFFER, bounds=True),
            "NORMAL": buffer.add(turned.astype("<f4"), VERTEX_BUFFER),
        }
        for mode, turned in fields
    ]
    indices = buffer.add(triangles.astype("<u4").ravel(), INDEX_BUFFER)
    return {"attributes": attributes, "indices": indices, "material": 0, "targets": targets}


def _document(
    playback: Playback, buffer: _Buffer, primitive: dict[str, Any], sampler: dict[str, Any]
) -> dict[str, Any]:
    """The JSON chunk; the node turns gravity to −y, glTF's down."""
    turn = Rotation.from_matrix(upright(playback.scene.gravity)).as_quat()
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    surface = {"baseColorFactor": [*CLAY, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.6}
    return {
        "asset": {"version": "2.0", "generator": "ldsim"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": playback.title, "rotation": [float(x) for x in turn]}],
        "meshes": [{"primitives": [primitive], "weights": [0.0] * len(primitive["targets"])}],
        "materials": [{"pbrMetallicRoughness": surface}],
        "animations": [{"name": playback.motion, "samplers": [sampler], "channels": [channel]}],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)}],
    }


def _write_chunks(path: Path, document: dict[str, Any], binary: bytes) -> None:
    """The .glb container: a header and two chunks, each padded to four bytes."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    length = 12 + 8 + len(text) + 8 + len(binary)
    with path.open("wb") as stream:
        stream.write(struct.pack("<III", MAGIC, 2, length))
        stream.write(struct.pack("<II", len(text), JSON_CHUNK) + text)
        stream.write(struct.pack("<II", len(binary), BINARY_CHUNK) + binary)


def _area_vectors(a: Array, b: Array, triangles: NDArray[np.int32]) -> Array:
    """Σ (a₁ − a₀) × (b₂ − b₀) over the triangles of each vertex, (v, 3), of two fields there, (v, 3)."""
    (p, q, _), (r, _, s) = (np.moveaxis(field[triangles], 1, 0) for field in (a, b))
    total = np.zeros_like(a)
    for corner in triangles.T:
        np.add.at(total, corner, np.cross(q - p, s - r))
    return total


def vertex_normals(positions: Array, triangles: NDArray[np.int32]) -> Array:
    """Unit normals n = N / ‖N‖ with N the sum of the triangles' area vectors, (v, 3) float64."""
    N = _area_vectors(positions, positions, triangles)
    normals: Array = N / np.maximum(np.linalg.norm(N, axis=1, keepdims=True), 1e-300)
    return normals


def normal_derivative(positions: Array, triangles: NDArray[np.int32], direction: Array) -> Array:
    """∂n/∂x · direction, (v, 3) float64: (I − n nᵀ) dN / ‖N‖."""
    N = _area_vectors(positions, positions, triangles)
    change = _area_vectors(direction, positions, triangles) + _area_vectors(positions, direction, triangles)
    length = np.maximum(np.linalg.norm(N, axis=1, keepdims=True), 1e-300)
    n = N / length
    turned: Array = (change - n * np.einsum("vi,vi->v", n, change)[:, None]) / length
    return turned
