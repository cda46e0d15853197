"""Settings: what is allowed, what a refusal says, and which files it names."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from ldsim.artefacts.store import STAGE_OF
from ldsim.errors import SettingsError
from ldsim.mechanics.options import ScriptOptions
from ldsim.options import read_options
from ldsim.pipeline.files import resolve_path
from ldsim.settings import STAGES, Settings, load_settings, settings_of

SMALLEST: dict[str, Any] = {
    "experiment": "small",
    "mesh": {
        "shape": {"name": "beam"},
        "material": {"youngs_modulus": 1.0e5},
        "pins": [{"slab": {"axis": "x", "thickness": 0.01}}],
    },
    "snapshot": {"motions": [{"name": "a", "pulls": {"count": 1, "reach": 0.1}}]},
}


def written(folder: Path, content: object) -> Path:
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def changed(path: str, value: object) -> dict[str, Any]:
    """The smallest configuration with one dotted key set, or removed where the value is `...`."""
    content: dict[str, Any] = copy.deepcopy(SMALLEST)
    *sections, last = path.split(".")
    place: Any = content
    for part in sections:
        place = place[int(part)] if part.isdigit() else place.setdefault(part, {})
    if value is ...:
        del place[last]
    else:
        place[int(last) if last.isdigit() else last] = value
    return content


def test_the_smallest_configuration_is_complete(tmp_path: Path) -> None:
    settings = load_settings(written(tmp_path, SMALLEST))
    assert settings.mesh.time_step == 0.005
    assert settings.snapshot.roles == ("train",)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("trian", {}, ["unknown key 'trian'", "did you mean 'train'"]),
        ("train.learnig_rate", 1e-3, ["unknown key 'train.learnig_rate'", "did you mean 'learning_rate'"]),
        ("mesh.material.youngs", 1.0, ["unknown key 'mesh.material.youngs'", "did you mean 'youngs_modulus'"]),
        ("mesh.pins.0.slab.axes", "x", ["unknown key 'mesh.pins.0.slab.axes'", "did you mean 'axis'"]),
        ("snapshot.motions.0.pulls.sed", 1, ["unknown key 'snapshot.motions.0.pulls.sed'", "did you mean 'seed'"]),
        ("pca.zzz", 1, ["unknown key 'pca.zzz'", "known are", "tolerance_mm"]),
        ("train.epochs", "many", ["train.epochs", "integer", "'many'"]),
        ("train.epochs", 1.5, ["train.epochs", "integer", "1.5"]),
        ("mesh.gravity", [0, 1], ["mesh.gravity"]),
        ("mesh.material", 3, ["mesh.material", "3"]),
        ("train.r", 0, ["train.r", "greater than or equal to 1", "0"]),
        ("mesh.material.poisson_ratio", 0.5, ["mesh.material.poisson_ratio", "less than 0.5"]),
        ("mesh.time_step", -0.1, ["mesh.time_step", "greater than 0", "-0.1"]),
        ("mesh.density", float("nan"), ["mesh.density", "nan"]),
        ("mesh.time_step", float("inf"), ["mesh.time_step", "inf"]),
        ("mesh.gravity", [0, float("nan"), 0], ["mesh.gravity", "nan"]),
        ("mesh.material.model", "rubber", ["mesh.material.model", "'neo_hookean'", "'rubber'"]),
        ("experiment", "../x", ["experiment", "'../x'"]),
        ("mesh.file", "x.mesh", ["mesh", "exactly one of file, shape"]),
        ("mesh.shape", ..., ["mesh", "exactly one of file, shape"]),
        ("snapshot.motions.0.recording", "x.csv", ["snapshot.motions.0", "exactly one of recording, pulls"]),
        ("mesh.pins.0.ball", {"centre": [0, 0, 0], "radius": 1}, ["mesh.pins.0", "exactly one of slab, ball, box"]),
        ("mesh.pins.0.slab", ..., ["mesh.pins.0", "exactly one of slab, ball, box, vertices, group"]),
        ("mesh.pins", [{"box": {"min": [0, 1, 0], "max": [1, 0, 1]}}], ["mesh.pins.0.box", "must not be greater"]),
        ("mesh.pins", [{"vertices": []}], ["mesh.pins.0.vertices", "at least 1"]),
        ("mesh.pins", [{"vertices": [-1]}], ["mesh.pins.0.vertices.0", "greater than or equal to 0"]),
        ("mesh.material.youngs_modulus", -1.0, ["mesh.material.youngs_modulus", "greater than 0", "-1"]),
        ("mesh.regions", [{"material": {}}], ["mesh.regions.0.where is missing"]),
        (
            "mesh.regions",
            [{"where": {"group": "a"}, "material": {"poisson_ratio": 0.5}}],
            ["mesh.regions.0.material.poisson_ratio", "less than 0.5"],
        ),
        ("mesh.scale", 0.001, ["mesh", "scale is 0.001, but a shape is given in metres"]),
        ("mesh.reorient", True, ["mesh", "reorient is of the cells of a mesh file"]),
        (
            "mesh",
            {name: given for name, given in SMALLEST["mesh"].items() if name != "shape"}
            | {"surface": {"file": "a.stl", "cells": 100}, "reorient": True},
            ["mesh", "reorient is of the cells of a mesh file"],
        ),
        (
            "snapshot.motions.0.pulls",
            {"count": 6, "reach": 0.1, "frames": 100_000, "rest": 100_000},
            ["snapshot.motions.0.pulls", "6 pulls of 200000 frames are 1200000; at most 1000000"],
        ),
        ("mesh.cell_data", {"density": "rho"}, ["mesh", "cell_data is read from a mesh file"]),
        (
            "mesh.loads",
            [{"where": {"group": "a"}, "pressure": 1.0, "traction": [0, 0, 1]}],
            ["mesh.loads.0", "exactly one of acceleration, traction, pressure"],
        ),
        (
            "snapshot.motions.0",
            {"name": "a", "script": {"moving_pins": [{"where": {"group": "a"}, "keyframes": [{"time": 0}]}]}},
            ["snapshot.motions.0.script.moving_pins.0.keyframes", "at least two keyframes, got 1"],
        ),
        (
            "snapshot.motions.0",
            {
                "name": "a",
                "script": {"gravity": {"keyframes": [{"time": t, "acceleration": [0, 0, 0]} for t in (2, 1)]}},
            },
            ["snapshot.motions.0.script.gravity.keyframes", "times of keyframes must rise, got [2.0, 1.0]"],
        ),
        (
            "snapshot.motions.0",
            # one fault: that the key is missing follows
            {"name": "a", "script": {"gravity": {"keyframes": [{"time": 0, "acceleratoin": [0, 0, 0]}]}}},
            ["snapshot.motions.0.script.gravity.keyframes.0.acceleratoin", "did you mean 'acceleration'?"],
        ),
        ("snapshot.motions.0", {"name": "a", "script": {}}, ["at least one of grabs, moving_pins, gravity"]),
        ("snapshot.test_share", 1.0, ["snapshot.test_share", "less than 1"]),
        ("snapshot.test_share", 0.5, ["snapshot", "at least one motion must have the role train"]),
        ("mesh", ..., ["mesh is missing"]),
        ("snapshot", ..., ["snapshot is missing"]),
        ("experiment", ..., ["experiment is missing"]),
        ("mesh.pins", [], ["mesh.pins", "at least 1"]),
        ("snapshot.motions.0.role", "test", ["snapshot", "at least one motion must have the role train"]),
    ],
)
def test_a_fault_is_named_with_its_path_and_what_is_allowed(
    tmp_path: Path, path: str, value: object, words: list[str]
) -> None:
    config = written(tmp_path, changed(path, value))
    with pytest.raises(SettingsError) as caught:
        load_settings(config)
    message = str(caught.value)
    assert str(config) in message
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("other", ["a", "A"])
def test_two_motions_of_one_name_are_refused_also_where_case_alone_tells_them_apart(tmp_path: Path, other: str) -> None:
    """Each has a file of its name, and on some systems those would be one."""
    (motion,) = SMALLEST["snapshot"]["motions"]
    twice = changed("snapshot.motions", [motion, motion | {"name": other}])
    with pytest.raises(SettingsError, match=f"different names, .* got a, {other}$"):
        load_settings(written(tmp_path, twice))


@pytest.mark.parametrize("word", ["yes", "no", "on", "off"])
def test_yes_and_no_are_no_numbers_and_are_taken_where_they_belong(tmp_path: Path, word: str) -> None:
    def loaded(key: str, value: object) -> Settings:
        config = written(tmp_path, changed(key, value))
        config.write_text(config.read_text("utf-8").replace("WORD", word), encoding="utf-8")
        return load_settings(config)

    with pytest.raises(SettingsError, match=r"mesh: density is (True|False); expected numbers or words"):
        loaded("mesh.density", "WORD")
    with pytest.raises(SettingsError, match=r"mesh: gravity is \[0, (True|False), 0\]; expected numbers or words"):
        loaded("mesh.gravity", [0, "WORD", 0])
    assert loaded("report.pictures", "WORD").report.pictures is (word in ("yes", "on"))


def test_all_faults_are_told_at_once(tmp_path: Path) -> None:
    content = changed("train.r", 0) | {"pca": {"k": -1}}
    with pytest.raises(SettingsError, match=r"2 things are wrong\npca\.k.*\ntrain\.r"):
        load_settings(written(tmp_path, content))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"# only a comment\n", "is empty"),
        (b"- a\n- b\n", "expected a mapping"),
        (b"mesh: [1, 2\n", "not valid YAML"),
        (b"\xff\xfe\x00", "not valid YAML"),
        (b"experiment: !!python/object:os.system {}\n", "not valid YAML"),
    ],
)
def test_a_file_that_is_no_configuration_is_refused_in_one_line(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match=words) as caught:
        load_settings(path)
    assert "\n" not in str(caught.value)


def test_what_is_dumped_with_defaults_loads_as_the_same_settings(tmp_path: Path) -> None:
    settings = load_settings(written(tmp_path, SMALLEST))
    again = tmp_path / "again.yaml"
    again.write_text(settings.dump(), encoding="utf-8")
    assert load_settings(again) == settings
    assert load_settings(again).dump() == settings.dump()


def test_every_stage_has_a_section(tmp_path: Path) -> None:
    settings = load_settings(written(tmp_path, SMALLEST))
    assert STAGES == (*STAGE_OF.values(), "report")
    for stage in STAGES:
        assert settings.section(stage) is getattr(settings, stage)


def test_without_the_data_variable_the_message_says_what_is_missing_and_where_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("LDSIM_DATA", raising=False)
    with pytest.raises(SettingsError, match=r"\$LDSIM_DATA/x\.mesh needs .* LDSIM_DATA.*lawsonfulton/AutoDef"):
        resolve_path("$LDSIM_DATA/x.mesh", tmp_path)


def test_a_file_missing_from_the_data_folder_is_named_with_the_variable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LDSIM_DATA", str(tmp_path))
    with pytest.raises(SettingsError, match=r"x\.mesh does not exist; LDSIM_DATA says"):
        resolve_path("${LDSIM_DATA}/x.mesh", tmp_path)


def test_a_path_is_relative_to_the_configuration_unless_it_starts_with_the_data_variable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, configs = tmp_path / "data", tmp_path / "configs"
    for folder in (data, configs):
        folder.mkdir()
        (folder / "x.mesh").touch()
    monkeypatch.setenv("LDSIM_DATA", str(data))
    assert resolve_path("x.mesh", configs) == configs / "x.mesh"
    assert resolve_path("$LDSIM_DATA/x.mesh", configs) == data / "x.mesh"


def of_motions(roles: list[str | None], **keys: object) -> dict[str, Any]:
    pulls = {"count": 1, "reach": 0.1}
    motions = [{"name": f"m{i}", "pulls": pulls} | ({"role": role} if role else {}) for i, role in enumerate(roles)]
    return SMALLEST | {"snapshot": {"motions": motions, **keys}}


def test_a_share_of_the_motions_without_a_role_is_held_out_by_its_seed(tmp_path: Path) -> None:
    given: list[str | None] = ["test", "train", *[None] * 8]

    def roles(seed: int) -> tuple[str, ...]:
        content = of_motions(given, test_share=0.25, test_seed=seed)
        return load_settings(written(tmp_path, content)).snapshot.roles

    assert roles(0)[:2] == ("test", "train")
    assert all(roles(seed)[2:].count("test") == 2 for seed in range(10))
    assert roles(3) == roles(3)
    assert len({roles(seed) for seed in range(10)}) > 3


def test_a_further_motion_mostly_leaves_the_others_their_roles() -> None:
    """So that those that nothing has looked at stay so: of 9 with 2 tests, it takes the place of one in 2/9 of all."""

    def roles(count: int, seed: int) -> tuple[str, ...]:
        content = of_motions([None] * count, test_share=0.25, test_seed=seed)
        return settings_of(content, "a test").snapshot.roles

    kept = [roles(9, seed)[:8] == roles(8, seed) for seed in range(200)]
    assert sum(kept) / 200 == pytest.approx(7 / 9, abs=4 * math.sqrt(7 / 9 * 2 / 9 / 200))


def test_a_small_share_still_holds_one_motion_out(tmp_path: Path) -> None:
    settings = load_settings(written(tmp_path, of_motions([None, None, None], test_share=0.01)))
    assert sorted(settings.snapshot.roles) == ["test", "train", "train"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("grabs: 3\n", "script .*: grabs: "),
        ("gravity: {keyframe: []}\n", "unknown key 'gravity.keyframe'; did you mean 'keyframes'"),
        ("grab: []\n", "unknown key 'grab'; did you mean 'grabs'"),
    ],
)
def test_a_bad_script_is_told_like_a_bad_configuration(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "script.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError, match=words) as caught:
        read_options(path, "script", ScriptOptions)
    assert "script.yaml" in str(caught.value)


def test_synthetic_motions_have_inertia(tmp_path: Path) -> None:
    content = of_motions(["train"], quasistatic=True) | {"pca": {"synthetic": {"count": 1, "reach": 0.1}}}
    with pytest.raises(SettingsError, match="pca.synthetic steps with inertia"):
        load_settings(written(tmp_path, content))


def test_pins_that_move_are_refused_of_a_condensed_space_before_anything_runs(tmp_path: Path) -> None:
    content = of_motions(["train", "validation", "test"])
    where = {"slab": {"axis": "x", "thickness": 0.001}}
    script = {"moving_pins": [{"where": where, "keyframes": [{"time": 0}, {"time": 1, "angle": 30}]}]}
    for i, refused in enumerate([True, True, False]):
        motions = [dict(motion) for motion in content["snapshot"]["motions"]]
        motions[i] = {"name": "twist", "role": motions[i]["role"], "script": script}
        asked = content | {"snapshot": content["snapshot"] | {"motions": motions}}
        load_settings(written(tmp_path, asked | {"train": {"kind": "autoencoder"}}))
        if refused:
            with pytest.raises(SettingsError, match="condensed, but pins move in motion twist; use train.kind: auto"):
                load_settings(written(tmp_path, asked))
        else:
            load_settings(written(tmp_path, asked))


@pytest.mark.parametrize("kind", ["autoencoder", "condensed"])
@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"train": {"r": 5}}, "train.r is 5; allowed are 1 … 4, the columns of the basis .pca.k."),
        ({"cubature": {"linear_sizes": [3, 6]}}, "cubature.linear_sizes has 6; the basis has 4 columns .pca.k."),
    ],
)
def test_more_columns_than_the_basis_can_have_are_refused_before_anything_runs(
    tmp_path: Path, kind: str, sections: dict[str, dict[str, Any]], words: str
) -> None:
    train = {"train": {"kind": kind} | sections.get("train", {})}
    asked = SMALLEST | sections | train
    open_ = {"pca": {"criterion": "max_error"}}  # of as many as it takes, nothing is known
    assert load_settings(written(tmp_path, asked | open_)).pca.columns is None
    assert load_settings(written(tmp_path, asked)).pca.columns == 40
    assert load_settings(written(tmp_path, asked | {"pca": {"k": 6}})).pca.k == 6
    with pytest.raises(SettingsError, match=words):
        load_settings(written(tmp_path, asked | {"pca": {"k": 4}}))
