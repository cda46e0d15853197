"""glTF: read back by a reader written here, and by Khronos' validator where it is installed."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.errors import ExportError
from ldsim.export.drawn import normal_derivative, vertex_normals
from ldsim.export.gltf import write_glb
from ldsim.export.playback import playback
from ldsim.mesh.surface import Surface
from ldsim.run import Run
from tests.helpers import derivative_order

Accessor = Callable[[int], NDArray[np.generic]]

ROOT = Path(__file__).parents[2]
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}
TYPE = {5126: "<f4", 5125: "<u4"}
VALIDATE = """
const validator = require('gltf-validator');
validator.validateBytes(new Uint8Array(require('fs').readFileSync(process.argv[1])))
  .then((report) => console.log(JSON.stringify(report.issues)));
"""


@pytest.fixture(params=["linear", "latent"])
def space(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def read_glb(path: Path) -> tuple[dict[str, Any], Accessor]:
    """The document, and a function that gives an accessor's values, (count,) or (count, 3)."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    json_length, json_kind = struct.unpack_from("<I4s", data, 12)
    assert json_kind == b"JSON"
    document = json.loads(data[20 : 20 + json_length])
    size, kind = struct.unpack_from("<I4s", data, 20 + json_length)
    binary = data[28 + json_length :]
    assert (kind, size) == (b"BIN\0", len(binary))
    assert document["buffers"][0]["byteLength"] <= len(binary)

    def accessor(number: int) -> NDArray[np.generic]:
        entry = document["accessors"][number]
        view = document["bufferViews"][entry["bufferView"]]
        columns = WIDTH[entry["type"]]
        values = np.frombuffer(
            binary, TYPE[entry["componentType"]], entry["count"] * columns, view["byteOffset"]
        ).reshape(-1, columns)
        if "min" in entry:
            np.testing.assert_array_equal(values.min(axis=0), np.float32(entry["min"]))
            np.testing.assert_array_equal(values.max(axis=0), np.float32(entry["max"]))
        return values[:, 0] if columns == 1 else values

    return document, accessor


def test_playing_the_morph_targets_gives_the_deformed_surface(run: Run, space: str, tmp_path: Path) -> None:
    played = playback(run, "pull_1", space)
    write_glb(played, tmp_path / "a.glb")
    document, accessor = read_glb(tmp_path / "a.glb")
    primitive = document["meshes"][0]["primitives"][0]
    sampler = document["animations"][0]["samplers"][0]
    times, weights = accessor(sampler["input"]), accessor(sampler["output"])
    rest = accessor(primitive["attributes"]["POSITION"])
    targets = np.stack([accessor(target["POSITION"]) for target in primitive["targets"]])
    surface = Surface.of(played.mesh)
    np.testing.assert_array_equal(accessor(primitive["indices"]).reshape(-1, 3), surface.triangles)
    np.testing.assert_allclose(times, [played.time(i) for i in range(played.frames)], rtol=1e-6)
    assert np.abs(weights).max() <= 1
    for frame, w in enumerate(weights.reshape(played.frames, -1)):
        morphed = rest + np.einsum("j,jvi->vi", w, targets)
        expected = (played.mesh.vertices + played.displacement(frame))[surface.vertices]
        np.testing.assert_allclose(morphed, expected, atol=4 * np.finfo(np.float32).eps * played.mesh.diagonal)


def test_columns_that_move_nothing_are_no_morph_targets(run: Run, tmp_path: Path) -> None:
    """As those of a condensed space's features are."""
    played = playback(run, "pull_1", "linear")
    assert played.U is not None and played.coordinates is not None
    U, q = np.insert(played.U, 1, 0.0, axis=1), np.insert(played.coordinates, 1, 7.0, axis=1)
    for beside in (None, played.displacement):
        write_glb(replace(played, beside=beside), tmp_path / "a.glb")
        write_glb(replace(played, U=U, coordinates=q, beside=beside), tmp_path / "b.glb")
        assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()


def test_the_morphed_normals_are_those_of_the_deformed_surface_to_first_order(run: Run) -> None:
    surface = Surface.of(run.scene.mesh)
    x = run.scene.mesh.vertices[surface.vertices]
    d = run.basis.matrix[:, 2].reshape(-1, 3)[surface.vertices]
    order = derivative_order(
        lambda y: vertex_normals(y, surface.triangles),
        lambda y: normal_derivative(y, surface.triangles, d),
        x,
        d,
        size=0.1 * run.scene.mesh.diagonal / np.abs(d).max(),
    )
    assert order > 1.9


def test_the_node_turns_gravity_downward(run: Run, tmp_path: Path) -> None:
    write_glb(playback(run, "push", "latent"), tmp_path / "a.glb")
    x, y, z, w = read_glb(tmp_path / "a.glb")[0]["nodes"][0]["rotation"]
    down = run.scene.gravity / np.linalg.norm(run.scene.gravity)
    twice = 2 * np.cross([x, y, z], down)
    np.testing.assert_allclose(down + w * twice + np.cross([x, y, z], twice), [0, -1, 0], atol=1e-12)


def test_the_full_space_is_refused(run: Run, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="use --space linear or latent"):
        write_glb(playback(run, "push", "full"), tmp_path / "a.glb")


def test_khronos_validator_has_nothing_to_report(run: Run, space: str, tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    if subprocess.run([node, "-e", "require('gltf-validator')"], cwd=ROOT, capture_output=True).returncode:
        pytest.skip("Khronos' validator is not installed: npm install --no-save gltf-validator")
    write_glb(playback(run, "pull_1", space), tmp_path / "a.glb")
    done = subprocess.run(
        [node, "-e", VALIDATE, str(tmp_path / "a.glb")], cwd=ROOT, capture_output=True, text=True, check=True
    )
    issues = json.loads(done.stdout)
    assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"]
