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
from ldsim.errors import ExportError
from ldsim.export.drawn import Drawn
from ldsim.export.playback import Playback
from ldsim.mesh.skin import Paint, Skin
from ldsim.report.camera import upright
from ldsim.report.drawing import CLAY

COMPONENT = {"f4": 5126, "u4": 5125}
SHAPE = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3"}
MIME = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
VERTEX_BUFFER, INDEX_BUFFER = 34962, 34963
MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942


@dataclass
class _Buffer:
    """The binary chunk as it grows, with the views and accessors into it."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, int]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add_bytes(self, data: bytes, target: int | None = None) -> int:
        """Append bytes, from a multiple of four on; returns the view's number."""
        self.data += bytes(-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(view if target is None else view | {"target": target})
        self.data += data
        return len(self.views) - 1

    def add(self, values: NDArray[np.generic], target: int | None = None, bounds: bool = False) -> int:
        """Append (count,) to (count, 3) float32 or uint32 values; returns the accessor's number."""
        little = np.ascontiguousarray(values)
        accessor: dict[str, Any] = {
            "bufferView": self.add_bytes(little.tobytes(), target),
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
        ExportError: the motion is of the full space, which has no basis, or a texture is neither PNG nor JPEG.
        MeshError: the skin lies far outside of the solid.
    """
    U, coordinates = playback.reduced("glTF")
    drawn = playback.drawn
    reach = np.abs(coordinates).max(axis=0)
    reach[reach == 0] = 1.0
    modes = drawn.moved(U.reshape(playback.mesh.n_vertices, 3, -1)) * reach
    buffer = _Buffer()
    primitives = _primitives(buffer, drawn, modes)
    weights = (coordinates / reach).astype("<f4").ravel()
    times = np.array([playback.time(frame) for frame in range(playback.frames)], dtype="<f4")
    sampler = {"input": buffer.add(times, bounds=True), "output": buffer.add(weights), "interpolation": "LINEAR"}
    _write_chunks(path, _document(playback, buffer, primitives, sampler), bytes(buffer.data))


def _primitives(buffer: _Buffer, drawn: Drawn, modes: Array) -> list[dict[str, Any]]:
    """The surface (v, 3) with one morph target a mode, (v, 3, k); of a skin, a primitive a part."""
    attributes = {
        "POSITION": buffer.add(drawn.rest.astype("<f4"), VERTEX_BUFFER, bounds=True),
        "NORMAL": buffer.add(drawn.normals.astype("<f4"), VERTEX_BUFFER),
    }
    if drawn.skin is not None and drawn.skin.uv is not None:
        attributes["TEXCOORD_0"] = buffer.add(drawn.skin.uv.astype("<f4"), VERTEX_BUFFER)
    fields = [(modes[:, :, j], drawn.normal_derivative(modes[:, :, j])) for j in range(modes.shape[2])]
    targets = [
        {
            "POSITION": buffer.add(mode.astype("<f4"), VERTEX_BUFFER, bounds=True),
            "NORMAL": buffer.add(turned.astype("<f4"), VERTEX_BUFFER),
        }
        for mode, turned in fields
    ]
    part = np.zeros(len(drawn.triangles), dtype=np.int64) if drawn.skin is None else drawn.skin.part
    return [
        {
            "attributes": attributes,
            "indices": buffer.add(drawn.triangles[part == number].astype("<u4").ravel(), INDEX_BUFFER),
            "material": int(number),
            "targets": targets,
        }
        for number in np.unique(part)
    ]


def _materials(buffer: _Buffer, skin: Skin | None) -> dict[str, Any]:
    """The looks of a skin's parts, with their pictures inside; clay where there is no skin."""
    looks = (Paint("clay", (*CLAY, 1.0)),) if skin is None else tuple(look for _, look in skin.parts)
    found: dict[str, Any] = {"materials": [], "images": [], "textures": []}
    for look in looks:
        paint: dict[str, Any] = {"baseColorFactor": [*look.colour]}
        paint |= {"metallicFactor": look.metallic, "roughnessFactor": look.roughness}
        if look.texture:
            if look.suffix not in MIME:
                raise ExportError(f"the texture of {look.name} is a {look.suffix} file; glTF has {', '.join(MIME)}")
            paint["baseColorTexture"] = {"index": len(found["textures"])}
            found["textures"].append({"source": len(found["images"])})
            found["images"].append({"bufferView": buffer.add_bytes(look.texture), "mimeType": MIME[look.suffix]})
        # without a mode, alpha is not looked at
        mode = {"alphaMode": "BLEND"} if look.colour[3] < 1 else {}
        found["materials"].append({"name": look.name, "pbrMetallicRoughness": paint, **mode})
    return {name: entries for name, entries in found.items() if entries}


def _document(
    playback: Playback, buffer: _Buffer, primitives: list[dict[str, Any]], sampler: dict[str, Any]
) -> dict[str, Any]:
    """The JSON chunk; the node turns gravity to −y, glTF's down."""
    turn = Rotation.from_matrix(upright(playback.scene.gravity)).as_quat()
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    materials = _materials(buffer, playback.skin)
    return {
        "asset": {"version": "2.0", "generator": "ldsim"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": playback.title, "rotation": [float(x) for x in turn]}],
        "meshes": [{"primitives": primitives, "weights": [0.0] * len(primitives[0]["targets"])}],
        **materials,
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
