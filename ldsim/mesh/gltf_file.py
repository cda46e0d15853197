"""Reads the surfaces of glTF 2.0 files, .glb or .gltf, with their textures (Khronos, glTF 2.0)."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ldsim.arrays import Array
from ldsim.errors import MeshError
from ldsim.mesh.skin import Paint, Skin

TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
TRIANGLES = 4
MAGIC, BINARY = b"glTF", 0x004E4942
SUFFIXES = {"image/png": ".png", "image/jpeg": ".jpg"}
# What a file that is damaged, or another one by this name, may lead to.
FAILURES = OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, struct.error


def read_gltf(path: Path) -> Skin:
    """All triangles of the file's scene at rest, each primitive a part named after its mesh.

    Raises:
        MeshError: it cannot be read, is compressed, or holds no triangles.
    """
    try:
        return _File(path).skin()
    except FAILURES as error:
        raise MeshError(f"{path} is not a readable glTF file ({error!r})") from error


def files_of_gltf(path: Path) -> list[str]:
    """The files beside a .gltf that it names; none of one that cannot be read."""
    try:
        document = _File(path).document
        entries = [entry for kind in ("buffers", "images") for entry in document.get(kind, [])]
        return [unquote(entry["uri"]) for entry in entries if not entry.get("uri", "data:").startswith("data:")]
    except FAILURES:
        return []


class _File:
    def __init__(self, path: Path) -> None:
        self._path, data, self._binary = path, path.read_bytes(), b""
        if data[:4] == MAGIC:
            size = struct.unpack_from("<I", data, 12)[0]
            text = data[20 : 20 + size]
            if len(data) > 20 + size:
                length, kind = struct.unpack_from("<II", data, 20 + size)
                self._binary = data[28 + size : 28 + size + length] if kind == BINARY else b""
        else:
            text = data
        self.document: dict[str, Any] = json.loads(text)
        needed = self.document.get("extensionsRequired", [])
        if needed:
            raise ValueError(f"it needs the extensions {', '.join(needed)}, which are not read")
        self._buffers: dict[int, bytes] = {}

    def skin(self) -> Skin:
        pieces = list(self._placed())
        if not pieces:
            raise MeshError(f"{self._path} holds no triangles")
        starts = np.cumsum([0, *(len(x) for x, *_ in pieces)])
        triangles = np.concatenate([t + start for (_, t, *_), start in zip(pieces, starts[:-1], strict=True)])
        uvs, normals = [p[2] for p in pieces], [p[3] for p in pieces]
        return Skin(
            np.concatenate([x for x, *_ in pieces]),
            triangles,
            None
            if all(uv is None for uv in uvs)
            else np.concatenate([_or_zero(uv, p[0], 2) for uv, p in zip(uvs, pieces, strict=True)]),
            None if any(n is None for n in normals) else np.concatenate([n for n in normals if n is not None]),
            np.repeat(np.arange(len(pieces)), [len(t) for _, t, *_ in pieces]),
            tuple(part for *_, part in pieces),
        )

    def _placed(self) -> Iterator[tuple[Array, NDArray[np.int64], Array | None, Array | None, tuple[str, Paint]]]:
        """Positions, triangles, texture coordinates, normals and part of each primitive, where its node puts it."""
        nodes = self.document.get("nodes", [])
        children = {child for node in nodes for child in node.get("children", [])}
        scenes = self.document.get("scenes", [{"nodes": [i for i in range(len(nodes)) if i not in children]}])
        todo = [(node, np.eye(4)) for node in scenes[self.document.get("scene", 0)].get("nodes", [])]
        placed: set[int] = set()
        while todo:
            number, above = todo.pop(0)
            if number in placed:  # it would be drawn twice, or for ever
                raise ValueError(f"node {number} is placed twice")
            placed.add(number)
            node = nodes[number]
            place = above @ _matrix(node)
            todo += [(child, place) for child in node.get("children", [])]
            if "mesh" not in node:
                continue
            mesh = self.document["meshes"][node["mesh"]]
            for primitive in mesh["primitives"]:
                if primitive.get("mode", TRIANGLES) == TRIANGLES:
                    yield self._primitive(primitive, place, str(mesh.get("name", f"mesh_{node['mesh']}")))

    def _primitive(
        self, primitive: dict[str, Any], place: Array, name: str
    ) -> tuple[Array, NDArray[np.int64], Array | None, Array | None, tuple[str, Paint]]:
        attributes = primitive["attributes"]
        x = self._values(attributes["POSITION"])
        corners = self._values(primitive["indices"]).ravel() if "indices" in primitive else np.arange(len(x))
        uv = self._values(attributes["TEXCOORD_0"]) if "TEXCOORD_0" in attributes else None
        normals = self._values(attributes["NORMAL"]) if "NORMAL" in attributes else None
        if normals is not None:
            normals = normals @ np.linalg.inv(place[:3, :3])
            normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        triangles = corners.astype(np.int64).reshape(-1, 3)
        if np.linalg.det(place[:3, :3]) < 0:
            triangles = triangles[:, ::-1]
        return x @ place[:3, :3].T + place[:3, 3], triangles, uv, normals, (name, self._look(primitive.get("material")))

    def _values(self, number: int) -> Array:
        """An accessor as float64, (count, columns); integers that stand for shares become these."""
        entry = self.document["accessors"][number]
        if "sparse" in entry or "bufferView" not in entry:
            raise ValueError("sparse accessors are not read")
        view, columns = self.document["bufferViews"][entry["bufferView"]], COLUMNS[entry["type"]]
        kind = np.dtype(TYPES[entry["componentType"]])
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        stride, count = view.get("byteStride", columns * kind.itemsize), entry["count"]
        data = self._buffer(view["buffer"])
        if start + stride * (count - 1) + columns * kind.itemsize > len(data):
            raise ValueError("an accessor reaches beyond its buffer")
        raw = np.ndarray((count, columns), kind, data, start, (stride, kind.itemsize)).astype(np.float64)
        share = entry.get("normalized", False) and kind.kind in "iu"
        return raw / np.iinfo(kind).max if share else raw

    def _look(self, number: int | None) -> Paint:
        if number is None:
            return Paint("surface")
        material = self.document["materials"][number]
        paint = material.get("pbrMetallicRoughness", {})
        red, green, blue, alpha = paint.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        texture, suffix = self._picture(paint["baseColorTexture"]) if "baseColorTexture" in paint else (b"", "")
        name = str(material.get("name", f"material_{number}"))
        surface = (paint.get("metallicFactor", 1.0), paint.get("roughnessFactor", 1.0))
        return Paint(name, (red, green, blue, alpha), texture, suffix, *surface)

    def _picture(self, texture: dict[str, Any]) -> tuple[bytes, str]:
        image = self.document["images"][self.document["textures"][texture["index"]]["source"]]
        if "bufferView" in image:
            view = self.document["bufferViews"][image["bufferView"]]
            start = view.get("byteOffset", 0)
            return self._buffer(view["buffer"])[start : start + view["byteLength"]], SUFFIXES[image["mimeType"]]
        data = self._uri(image["uri"])
        return data, ".png" if data[:4] == b"\x89PNG" else ".jpg"

    def _buffer(self, number: int) -> bytes:
        if number not in self._buffers:
            entry = self.document["buffers"][number]
            self._buffers[number] = self._uri(entry["uri"]) if "uri" in entry else self._binary
        return self._buffers[number]

    def _uri(self, uri: str) -> bytes:
        """Data inside the file, or of a file beside it."""
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        place = Path(unquote(uri))
        if place.is_absolute() or ".." in place.parts or "://" in uri:
            raise ValueError(f"the file {uri!r} does not lie beside it")
        return (self._path.parent / place).read_bytes()


def _or_zero(uv: Array | None, x: Array, columns: int) -> Array:
    return np.zeros((len(x), columns)) if uv is None else uv


def _matrix(node: dict[str, Any]) -> Array:
    """Where a node lies in the one above, (4, 4)."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat(node.get("rotation", (0.0, 0.0, 0.0, 1.0))).as_matrix()
    found[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    found[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return found
