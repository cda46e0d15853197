"""A box with a texture, as OBJ and as glTF, made here: two parts, one with a picture, and a seam along each edge."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np

from ldsim.arrays import Array

# A red and a green pixel.
_ROWS = zlib.compress(b"\0\xff\0\0\0\xff\0")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


PICTURE = b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 1, 8, 2, 0, 0, 0))
PICTURE += _chunk(b"IDAT", _ROWS) + _chunk(b"IEND", b"")

# Of each side the axis across it, and which end.
SIDES = [(axis, end) for axis in range(3) for end in (0, 1)]
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def box(low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Corners by side (6, 4, 3), outward quads; texture coordinates (6, 4, 2); normals (6, 3)."""
    corners, normals = np.zeros((6, 4, 3)), np.zeros((6, 3))
    for i, (axis, end) in enumerate(SIDES):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        square = SQUARE if end else SQUARE[::-1]
        corners[i][:, axis] = (low, high)[end][axis]
        for j, other in enumerate((u, v)):
            corners[i][:, other] = low[other] + square[:, j] * (high - low)[other]
        normals[i, axis] = 2 * end - 1
    return corners, np.tile(SQUARE, (6, 1, 1)), normals


def write_obj(folder: Path, low: Array, high: Array) -> Path:
    """painted.obj with painted.mtl and painted.png: quads; the first two sides are wood, the others paint."""
    corners, uv, normals = box(low, high)
    lines = ["# a box", "mtllib painted.mtl", *(f"v {x} {y} {z}" for x, y, z in corners.reshape(-1, 3).tolist())]
    lines += [f"vt {u} {v}" for u, v in uv.reshape(-1, 2).tolist()]
    lines += [f"vn {x} {y} {z}" for x, y, z in normals.tolist()]
    for side in range(6):
        lines += {0: ["g ends", "usemtl wood"], 2: ["g sides", "usemtl paint"]}.get(side, [])
        lines.append("f " + " ".join(f"{4 * side + i + 1}/{4 * side + i + 1}/{side + 1}" for i in range(4)))
    file = folder / "painted.obj"
    file.write_text("\n".join(lines) + "\n")
    (folder / "painted.mtl").write_text(
        "newmtl wood\nKd 1 0.5 0.25\nmap_Kd painted.png\nnewmtl paint\nKd 0 0 1\nd 0.5\n"
    )
    (folder / "painted.png").write_bytes(PICTURE)
    return file


def write_gltf(folder: Path, low: Array, high: Array, binary: bool) -> Path:
    """The same as .glb or .gltf; the node doubles, turns and shifts what the mesh holds of it."""
    corners, uv, normals = box(low, high)
    uv = uv * [1, -1] + [0, 1]
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # a quarter around z
    inside, shift = (corners - low) @ turn / 2, low
    data, views, accessors = b"", [], []

    def add(values: np.ndarray, kind: str, component: int) -> int:
        nonlocal data
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        data += values.tobytes() + bytes(-values.nbytes % 4)
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind})
        return len(accessors) - 1

    primitives = []
    for number, sides in enumerate((range(2), range(2, 6))):
        some = list(sides)
        quads = 4 * np.arange(len(some))[:, None, None] + [[0, 1, 2], [0, 2, 3]]
        attributes = {
            "POSITION": add(inside[some].reshape(-1, 3).astype("<f4"), "VEC3", 5126),
            "NORMAL": add(np.repeat(normals[some] @ turn, 4, axis=0).astype("<f4"), "VEC3", 5126),
            "TEXCOORD_0": add(uv[some].reshape(-1, 2).astype("<f4"), "VEC2", 5126),
        }
        indices = add(quads.ravel().astype("<u2"), "SCALAR", 5123)
        primitives.append({"attributes": attributes, "indices": indices, "material": number})
    views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(PICTURE)})
    data += PICTURE + bytes(-len(PICTURE) % 4)
    wood = {"baseColorFactor": [1, 0.5, 0.25, 1], "baseColorTexture": {"index": 0}, "metallicFactor": 0}
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"children": [1], "translation": shift.tolist(), "scale": [2, 2, 2]},
            {"mesh": 0, "rotation": [0, 0, 0.5**0.5, 0.5**0.5]},
        ],
        "meshes": [{"name": "box", "primitives": primitives}],
        "materials": [
            {"name": "wood", "pbrMetallicRoughness": wood},
            {"name": "paint", "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 1, 0.5]}},
        ],
        "images": [{"bufferView": len(views) - 1, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)} | ({} if binary else {"uri": "painted%20box.bin"})],
    }
    text = json.dumps(document).encode()
    if not binary:
        (folder / "painted box.bin").write_bytes(data)
        file = folder / "painted.gltf"
        file.write_bytes(text)
        return file
    text += b" " * (-len(text) % 4)
    file = folder / "painted.glb"
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    file.write_bytes(head + chunks)
    return file


WRITERS = {
    "obj": write_obj,
    "glb": lambda folder, low, high: write_gltf(folder, low, high, True),
    "gltf": lambda folder, low, high: write_gltf(folder, low, high, False),
}
