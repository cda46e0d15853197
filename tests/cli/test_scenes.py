"""The examples of configs/ as a user meets them: each is valid, and its scene and motions can be made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from ldsim.artefacts.records import read_scene
from ldsim.errors import LdsimError
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene, properties_of
from ldsim.mesh.shapes import beam
from ldsim.pipeline.options import MotionOptions
from ldsim.pipeline.snapshot import motion
from ldsim.settings import load_settings
from tests.cli.experiments import invoked
from tests.helpers import uniform_scene

ROOT = Path(__file__).parents[2]
CONFIGS = sorted((ROOT / "configs").glob("*.yaml"))
BEAM = beam(resolution=2)
ENDS = (BEAM.vertices[:, 0] < 0.001) | (BEAM.vertices[:, 0] > 0.399)
BODY = uniform_scene(BEAM, ENDS, time_step=0.01)


def made(name: str, folder: Path) -> tuple[Scene, list[Motion]]:
    """The scene of an example and its motions."""
    config = ROOT / "configs" / f"{name}.yaml"
    result = invoked("mesh", str(config), "--runs", str(folder))
    assert result.exit_code == 0, result.output
    scene, _ = read_scene(folder / name / "scene.h5")
    return scene, [motion(scene, entry, config.parent) for entry in load_settings(config).snapshot.motions]


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
def test_every_example_is_valid_and_named_after_its_file(config: Path) -> None:
    assert load_settings(config).experiment == config.stem


@pytest.mark.parametrize("name", [path.stem for path in CONFIGS if "LDSIM_DATA" not in path.read_text()])
def test_the_scene_and_the_motions_of_every_example_can_be_made(name: str, tmp_path: Path) -> None:
    scene, motions = made(name, tmp_path)
    assert scene.pinned.any()
    for each in motions:
        assert each.frames > 0
        assert each.drags or each.supports or each.gravity is not None


def test_regions_have_their_material_and_the_last_one_wins(tmp_path: Path) -> None:
    scene, _ = made("materials", tmp_path)
    properties, x = properties_of(scene), scene.mesh.vertices[scene.mesh.cells].mean(axis=1)[:, 0]
    middle, end = (x >= 0.12) & (x <= 0.22), x >= 0.35
    expected = np.where(middle, 4e4, np.where(end, 1e6, 2e5))
    np.testing.assert_allclose(properties.youngs_modulus, expected, rtol=1e-12)
    np.testing.assert_allclose(properties.poisson_ratio, np.where(end, 0.3, 0.45), rtol=1e-12)
    np.testing.assert_array_equal(scene.density, np.where(end, 3000, 1000))
    fixed, plain = MATERIALS["fixed_corotated"], MATERIALS["neo_hookean"]
    np.testing.assert_array_equal(scene.material, np.where(end, fixed, plain))


def test_a_group_pins_and_changes_what_the_file_says(tmp_path: Path) -> None:
    scene, _ = made("groups", tmp_path)
    np.testing.assert_array_equal(scene.pinned, scene.mesh.vertices[:, 0] == 0)
    core = np.abs(scene.mesh.vertices[scene.mesh.cells].mean(axis=1)[:, 1]) < 0.03
    np.testing.assert_allclose(properties_of(scene).youngs_modulus, np.where(core, 1e6, 1e5), rtol=1e-12)
    told = invoked("info", str(tmp_path / "groups" / "scene.h5")).stdout
    for name in ("core", "foot", "shell"):
        assert f"groups/{name}/vertices" in told


def test_material_read_cell_by_cell_is_that_of_the_file(tmp_path: Path) -> None:
    scene, _ = made("cell_data", tmp_path)
    x = scene.mesh.vertices[scene.mesh.cells].mean(axis=1)[:, 0]
    np.testing.assert_allclose(properties_of(scene).youngs_modulus, 5e4 + 1e6 * x, atol=1)
    np.testing.assert_allclose(scene.density, 800 + 2000 * x, atol=1)


def test_loads_of_a_scene_add_up(tmp_path: Path) -> None:
    scene, _ = made("loads", tmp_path)
    assert scene.load is not None
    np.testing.assert_allclose(scene.load.sum(axis=0), [500 * 0.01, 20, 200 * 0.04], rtol=1e-9)


def test_a_release_reaches_its_target_holds_it_and_lets_go() -> None:
    settings = {"point": [0.4, 0, 0], "target": [0.3, 0.1, 0], "pull": 0.2, "hold": 0.1, "swing": 0.3}
    let_go = built({"release": settings})
    (drag,) = let_go.drags
    assert (let_go.frames, drag.start, drag.stop) == (60, 0, 30)
    np.testing.assert_allclose(drag.targets[19:], [[0.3, 0.1, 0]] * 11, atol=1e-12)


def built(settings: dict[str, Any]) -> Motion:
    return motion(BODY, MotionOptions.model_validate({"name": "m"} | settings))


def moving(where: dict[str, Any], **keys: object) -> dict[str, Any]:
    return {"where": where, "keyframes": [{"time": 0}, {"time": 1, "angle": 90}]} | keys


RIGHT = {"slab": {"axis": "x", "at": "max", "thickness": 0.001}}
REFUSED = {
    "pins that are none": (
        {"script": {"moving_pins": [moving({"ball": {"centre": [0.2, 0, 0], "radius": 0.06}})]}},
        "holds no pinned vertex; only pins can follow a path",
    ),
    "pins of an unknown group": (
        {"script": {"moving_pins": [moving({"group": "lid"})]}},
        "no group 'lid'; known are none",
    ),
    "pins on two paths": (
        {"script": {"moving_pins": [moving(RIGHT), moving(RIGHT)]}},
        "follows two paths; regions of moving_pins must not overlap",
    ),
    "a turn about nothing": ({"script": {"moving_pins": [moving(RIGHT, axis=[0, 0, 0])]}}, "it must have a direction"),
    "a path that starts away": (
        {"script": {"moving_pins": [moving(RIGHT, keyframes=[{"time": 0, "angle": 5}, {"time": 1}])]}},
        "must start at rest: the keyframe at 0 s has translation [0.0, 0.0, 0.0] and angle 5",
    ),
    "a script that is not there": ({"script_file": "none.yaml"}, "none.yaml does not exist"),
    "a script of one keyframe": ({"script_file": "bad.yaml"}, "at least two keyframes, got 1"),
}


@pytest.mark.parametrize(("settings", "words"), REFUSED.values(), ids=REFUSED)
def test_a_motion_that_cannot_be_is_refused_by_name(settings: dict[str, Any], words: str, tmp_path: Path) -> None:
    path = [{"time": 0, "target": [0, 0, 0]}]
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump({"grabs": [{"point": [0, 0, 0], "keyframes": path}]}))
    with pytest.raises(LdsimError) as caught:
        motion(BODY, MotionOptions.model_validate({"name": "odd"} | settings), tmp_path)
    assert str(caught.value).startswith("motion odd: ")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_centre_left_out_is_the_middle_of_the_pins() -> None:
    turned = built({"script": {"moving_pins": [moving(RIGHT, axis=[1, 0, 0])]}})
    (support,) = turned.supports
    assert turned.frames == 100
    last = MovedPins(support.vertices, support.maps[99]).displacement(BEAM.vertices) + BEAM.vertices[support.vertices]
    x, y, z = BEAM.vertices[support.vertices].T
    np.testing.assert_allclose(last, np.stack([x, -z, y], axis=1), atol=1e-12)
