"""A surface of the user's own comes out deformed as the solid is, with its texture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ldsim.errors import ExportError, MeshError
from ldsim.export.formats import Choice, export
from ldsim.export.gltf import write_glb
from ldsim.export.playback import playback
from ldsim.mesh.formats import read_skin
from ldsim.mesh.surface import Surface
from ldsim.run import Run
from tests.export.test_gltf import read_glb
from tests.mesh.painted import PICTURE, WRITERS


@pytest.fixture(params=["obj", "glb"])
def painted(request: pytest.FixtureRequest, run: Run, tmp_path: Path) -> Path:
    """The box of the run's beam, a little larger than it."""
    x = run.scene.mesh.vertices
    margin = 0.01 * run.scene.mesh.diagonal
    return WRITERS[str(request.param)](tmp_path, x.min(axis=0) - margin, x.max(axis=0) + margin)


def test_as_gltf_it_deforms_with_its_texture(run: Run, painted: Path, tmp_path: Path) -> None:
    path, _ = export(run, Choice("gltf", "push", "linear", surface=painted), tmp_path / "a.glb")
    document, accessor = read_glb(path)
    primitives = document["meshes"][0]["primitives"]
    assert [document["materials"][p["material"]]["name"] for p in primitives] == ["wood", "paint"]
    assert [document["accessors"][p["indices"]]["count"] for p in primitives] == [12, 24]
    (image,) = document["images"]
    view = document["bufferViews"][image["bufferView"]]
    start = path.read_bytes().index(b"BIN\0") + 4 + view["byteOffset"]
    assert path.read_bytes()[start : start + view["byteLength"]] == PICTURE
    skin = read_skin(painted)
    assert skin.uv is not None
    np.testing.assert_allclose(accessor(primitives[0]["attributes"]["TEXCOORD_0"]), skin.uv, atol=1e-6)
    # each corner of the box moves about as the corner of the beam below it does
    played = playback(run, "push", "linear")
    rest = accessor(primitives[0]["attributes"]["POSITION"]).astype(np.float64)
    targets = np.array([accessor(t["POSITION"]) for t in primitives[0]["targets"]], dtype=np.float64)
    sampler = document["animations"][0]["samplers"][0]
    weights = accessor(sampler["output"]).reshape(played.frames, -1)
    mesh = played.mesh
    nearest = np.linalg.norm(rest[:, None] - mesh.vertices, axis=2).argmin(axis=1)
    for frame in range(played.frames):
        moved, u = np.tensordot(weights[frame], targets, 1), played.displacement(frame)
        assert np.abs(moved - u[nearest]).max() < 0.25 * np.abs(u).max()


def test_as_gltf_glass_is_seen_through_and_wood_is_not(run: Run, painted: Path, tmp_path: Path) -> None:
    skin = read_skin(painted)
    (wood, first), (glass, second) = skin.parts
    skin = replace(skin, parts=((wood, first), (glass, replace(second, colour=(1.0, 1.0, 1.0, 0.4)))))
    write_glb(replace(playback(run, "push", "linear"), skin=skin), tmp_path / "a.glb")
    materials = read_glb(tmp_path / "a.glb")[0]["materials"]
    assert [material.get("alphaMode", "OPAQUE") for material in materials] == ["OPAQUE", "BLEND"]


def test_as_obj_every_frame_has_it_with_its_picture(run: Run, painted: Path, tmp_path: Path) -> None:
    folder, _ = export(run, Choice("obj", "push", "linear", surface=painted), tmp_path / "made")
    played = playback(run, "push", "linear")
    files = sorted(folder.glob("*.obj"))
    assert len(files) == played.frames
    given, last = read_skin(painted), read_skin(files[-1])
    assert last.uv is not None and given.uv is not None
    corners, own = given.uv[given.triangles], last.uv[last.triangles]
    np.testing.assert_allclose(own, corners, atol=1e-6)
    assert [look.texture for _, look in last.parts] == [PICTURE, b""]
    assert [look.colour for _, look in last.parts] == [look.colour for _, look in given.parts]
    moved = last.positions[last.triangles] - given.positions[given.triangles]
    assert 0.5 < np.abs(moved).max() / np.abs(played.displacement(played.frames - 1)).max() < 2


def test_the_boundary_itself_as_a_skin_is_what_is_drawn_without_one(run: Run, tmp_path: Path) -> None:
    surface = Surface.of(run.scene.mesh)
    lines = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in surface.rest.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (surface.triangles + 1).tolist()]
    (tmp_path / "own.obj").write_text("\n".join(lines))
    with_skin, _ = export(run, Choice("gltf", "push", surface=tmp_path / "own.obj"), tmp_path / "a.glb")
    without, _ = export(run, Choice("gltf", "push"), tmp_path / "b.glb")
    (one, left), (other, right) = read_glb(with_skin), read_glb(without)

    def corners(document: dict, accessor: object, name: str) -> np.ndarray:
        (primitive,) = document["meshes"][0]["primitives"]
        attributes = [primitive["attributes"][name], *(target[name] for target in primitive["targets"])]
        triangles = accessor(primitive["indices"]).astype(int)
        return np.array([accessor(number)[triangles] for number in attributes])

    for name in ("POSITION", "NORMAL"):
        a, b = corners(one, left, name), corners(other, right, name)
        np.testing.assert_allclose(a, b, atol=1e-5 * np.abs(b).max())


def test_what_cannot_be_drawn_so_is_refused(run: Run, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="vtk draws no surface of your own; --surface is for gltf, usd, obj, ply"):
        export(run, Choice("vtk", surface=tmp_path / "a.obj"), tmp_path / "a")
    far = WRITERS["obj"](tmp_path, np.full(3, 50.0), np.full(3, 51.0))
    with pytest.raises(MeshError, match="outside of the mesh"):
        export(run, Choice("gltf", "push", surface=far), tmp_path / "a.glb")
