"""Surfaces as they are painted: read from OBJ and glTF alike, and what is wrong with a file said in a line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mesh.formats import read_skin, read_surface
from tests.mesh.painted import PICTURE, WRITERS, box

LOW, HIGH = np.array([1.0, 2.0, 3.0]), np.array([2.0, 2.5, 4.5])


@pytest.mark.parametrize("name", WRITERS)
def test_places_texture_normals_and_parts_are_as_they_were_painted(tmp_path: Path, name: str) -> None:
    skin = read_skin(WRITERS[name](tmp_path, LOW, HIGH), scale=2.0)
    corners, uv, normals = box(2 * LOW, 2 * HIGH)
    assert len(skin.positions) == 24 and len(skin.triangles) == 12
    assert skin.uv is not None and skin.normals is not None
    np.testing.assert_allclose(skin.positions, corners.reshape(-1, 3), atol=1e-6)
    np.testing.assert_allclose(skin.uv, uv.reshape(-1, 2) * [1, -1] + [0, 1], atol=1e-7)
    np.testing.assert_allclose(skin.normals, np.repeat(normals, 4, axis=0), atol=1e-6)
    a, b, c = np.moveaxis(skin.positions[skin.triangles], 1, 0)
    assert (np.einsum("ti,ti->t", np.cross(b - a, c - a), skin.normals[skin.triangles[:, 0]]) > 0).all()
    assert skin.part.tolist() == [0] * 4 + [1] * 8
    (_, wood), (_, paint) = skin.parts
    assert (wood.name, wood.colour, wood.texture, wood.suffix) == ("wood", (1, 0.5, 0.25, 1), PICTURE, ".png")
    assert (paint.name, paint.colour, paint.texture) == ("paint", (0, 0, 1, 0.5), b"")


@pytest.mark.parametrize("name", WRITERS)
def test_to_be_filled_with_tets_it_is_closed_though_its_texture_has_seams(tmp_path: Path, name: str) -> None:
    surface = read_surface(WRITERS[name](tmp_path, LOW, HIGH))
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert len(surface.vertices) == 8
    assert set(np.unique(edges, axis=0, return_counts=True)[1].tolist()) == {2}
    assert np.ptp(surface.vertices, axis=0) == pytest.approx(HIGH - LOW, abs=1e-6)


def test_without_scenes_each_node_is_drawn_once_where_those_above_it_put_it(tmp_path: Path) -> None:
    file = WRITERS["gltf"](tmp_path, LOW, HIGH)
    expected = read_skin(file)
    document = json.loads(file.read_text())
    del document["scenes"]
    file.write_text(json.dumps(document))
    found = read_skin(file)
    np.testing.assert_array_equal(found.positions, expected.positions)
    np.testing.assert_array_equal(found.triangles, expected.triangles)


def test_other_formats_have_places_alone(tmp_path: Path) -> None:
    (tmp_path / "a.off").write_text("OFF\n4 1 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n")
    skin = read_skin(tmp_path / "a.off", 0.5)
    assert skin.uv is None and skin.normals is None and skin.positions[1].tolist() == [0.5, 0, 0]


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl wood\nf 1 2 3\n"


def painted(folder: Path, materials: str, picture: str) -> bytes:
    """The texture of a triangle whose OBJ file lies in a folder and names its materials, and these their picture."""
    file = folder / "part.obj"
    file.write_text(f"mtllib {materials}\n{TRIANGLE}")
    place = folder / materials.replace("\\", "/")
    if place.parent.is_dir():
        place.write_text(f"newmtl wood\nKd 1 0 0\nmap_Kd {picture}\n")
    ((_, look),) = read_skin(file).parts
    return look.texture


@pytest.mark.parametrize(
    ("materials", "picture", "found"),
    [
        ("part.mtl", "textures/wood.png", True),
        ("part.mtl", "textures\\wood.png", True),
        ("mats/a.mtl", "../textures/wood.png", True),
        ("part.mtl", "textures/stone.png", False),
        ("none/a.mtl", "textures/wood.png", False),
        ("part.mtl", "../outside.png", False),
        ("part.mtl", "/{outside}", False),
        ("part.mtl", "C:\\art\\wood.png", False),
        ("part.mtl", "textures", False),
    ],
)
def test_materials_and_pictures_below_the_file_are_read_and_what_is_not_there_leaves_a_plain_look(
    tmp_path: Path, materials: str, picture: str, found: bool
) -> None:
    """Nor does somebody's file draw in pictures that lie elsewhere on this machine."""
    folder = tmp_path / "part"
    for name in ("textures", "mats"):
        (folder / name).mkdir(parents=True)
    for place in (folder / "textures" / "wood.png", tmp_path / "outside.png"):
        place.write_bytes(PICTURE)
    name = picture.format(outside=str(tmp_path / "outside.png").lstrip("/"))
    assert painted(folder, materials, name) == (PICTURE if found else b"")


@pytest.mark.parametrize(
    ("text", "encoding"), [(TRIANGLE, "utf-8-sig"), (TRIANGLE.replace(" ", "\t"), "utf-8")], ids=["mark", "tabs"]
)
def test_a_mark_of_the_encoding_and_tabs_are_understood(tmp_path: Path, text: str, encoding: str) -> None:
    (tmp_path / "part.obj").write_text(text, encoding=encoding)
    skin = read_skin(tmp_path / "part.obj")
    assert len(skin.positions) == 3 and skin.parts[0][1].name == "wood"


def test_normals_of_any_length_and_colours_beyond_1_become_what_gltf_allows(tmp_path: Path) -> None:
    (tmp_path / "part.mtl").write_text("newmtl wood\nKd 1.2 0.5 -1\nd 1.5\n")
    text = "mtllib part.mtl\nusemtl wood\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 {}\nf 1//1 2//1 3//1\n"
    (tmp_path / "part.obj").write_text(text.format(2))
    skin = read_skin(tmp_path / "part.obj")
    assert skin.normals is not None and skin.normals.tolist() == [[0.0, 0.0, 1.0]] * 3
    assert skin.parts[0][1].colour == (1.0, 0.5, 0.0, 1.0)
    (tmp_path / "part.obj").write_text(text.format(0))
    assert read_skin(tmp_path / "part.obj").normals is None


def _gltf(document: dict[str, object]) -> str:
    return json.dumps({"asset": {"version": "2.0"}, **document})


WRONG = {
    "missing": (None, "glb", "does not exist"),
    "corner": ("v 0 0 0\nv 1 0 0\nf 1 2 7\n", "obj", "line 3: f '1 2 7' is not understood"),
    "number": ("v 0 zero 0\n", "obj", "line 1: v '0 zero 0' is not understood"),
    "cut off": ("v 0 0 0\nv 1 0 0\nv 0 1", "obj", "line 3: v '0 1' is not understood .2 numbers, 3 are needed"),
    "short texture": ("vt 0.5 0.5\nvt 0.5\n", "obj", "line 2: vt '0.5' is not understood .1 numbers, 2 are needed"),
    "no faces": ("v 0 0 0\n", "obj", "the surface has no triangles"),
    "not finite": ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "obj", "not finite"),
    "no JSON": ("solid", "gltf", "not a readable glTF file"),
    "a list": ("[]", "gltf", "not a readable glTF file"),
    "nested": (100_000 * "[", "gltf", "not a readable glTF file"),
    "its own child": (
        _gltf({"scenes": [{"nodes": [0]}], "nodes": [{"children": [0]}]}),
        "gltf",
        "node 0 is placed twice",
    ),
    "empty": (_gltf({}), "gltf", "holds no triangles"),
    "compressed": (_gltf({"extensionsRequired": ["KHR_draco_mesh_compression"]}), "gltf", "KHR_draco_mesh_compression"),
    "elsewhere": (
        _gltf(
            {
                "nodes": [{"mesh": 0}],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
                "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
                "bufferViews": [{"buffer": 0, "byteLength": 36}],
                "buffers": [{"byteLength": 36, "uri": "../secret.bin"}],
            }
        ),
        "gltf",
        "does not lie beside it",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_with_a_file_is_said_in_a_line(tmp_path: Path, case: str) -> None:
    text, suffix, words = WRONG[case]
    file = tmp_path / f"a.{suffix}"
    if text is not None:
        file.write_text(text)
    with pytest.raises(MeshError, match=words) as error:
        read_skin(file)
    assert file.name in str(error.value) and "\n" not in str(error.value)
