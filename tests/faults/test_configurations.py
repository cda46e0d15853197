"""Configurations, meshes and recordings made to do harm: one line each, and at once."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
import yaml

from ldsim.errors import LdsimError, SettingsError
from ldsim.mechanics.recording import read_recording
from ldsim.pipeline.files import resolve_path
from ldsim.settings import load_settings
from tests.cli.experiments import TINY

WHOLE = yaml.safe_dump(TINY)


def with_line(old: str, new: str) -> str:
    assert old in WHOLE
    return WHOLE.replace(old, new, 1)


LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 8)}]\n" for i in range(1, 12))  # fmt: skip # noqa: E501
CONFIGURATIONS: dict[str, tuple[str, str]] = {
    "above the runs": (with_line("experiment: tiny", "experiment: .."), "experiment: "),
    "the runs themselves": (with_line("experiment: tiny", "experiment: ."), "experiment: "),
    "another folder": (with_line("experiment: tiny", "experiment: a/b"), "experiment: "),
    "a name of a file too long": (with_line("experiment: tiny", f"experiment: {'a' * 300}"), "experiment: "),
    "a motion named like a folder": (with_line("name: a", "name: .."), "name: "),
    "a key twice": (WHOLE + "experiment: other\n", "the key 'experiment' is there twice"),
    "a key twice in a section": (with_line("pca:\n", "pca:\n  k: 7\n"), "the key 'k' is there twice"),
    "brackets": ("[" * 2000, "is not valid YAML"),
    "braces": ("{a: " * 2000, "is not valid YAML"),
    "a date that does not exist": (WHOLE + "date: 2026-02-30\n", "is not valid YAML"),
    "five thousand digits": (with_line("k: 6", f"k: {'9' * 5000}"), "is not valid YAML"),
    "four hundred digits": (with_line("k: 6", f"k: {'9' * 400}"), "k is a number of 400 digits"),
    "unknown keys": (WHOLE + "".join(f"key{i}: 1\n" for i in range(20_000)), "and 19990 more"),
    "aliases of aliases": (LAUGHS, "aliases counted"),
    "an alias of itself": ("a: &a [*a]\n", "aliases counted"),
    "a python object": ("a: !!python/object/apply:os.system [true]\n", "is not valid YAML"),
    "a modulus that overflows": (with_line("youngs_modulus: 40000.0", "youngs_modulus: 1.0e+308"), "sizes up to"),
    "endless pulls": (with_line("count: 2", "count: 1000000000000000000"), "count: input should be less than"),
    "frames without end": (with_line("frames: 12", "frames: 1000000000000000000"), "frames: input should be less"),
    "a seed of 400 digits": (with_line("seed: 1", f"seed: {'1' * 400}"), "seed: input should be less than"),
    "a place far away": (
        with_line("slab:", "ball:\n      centre: [1.0e+300, 0, 0]\n      radius: 1\n  - slab:"),
        "centre is 1e+300",
    ),
}


@pytest.mark.parametrize("case", CONFIGURATIONS)
def test_a_hostile_configuration_is_refused_in_one_line_and_at_once(case: str, tmp_path: Path) -> None:
    content, words = CONFIGURATIONS[case]
    path = tmp_path / "a.yaml"
    path.write_text(content)
    started = time.monotonic()
    with pytest.raises(SettingsError) as caught:
        load_settings(path)
    assert words in str(caught.value)
    # one line, or one for each of the first ten faults
    assert str(caught.value).count("\n") == (11 if case == "unknown keys" else 0) and len(str(caught.value)) < 5000
    assert time.monotonic() - started < 20


def test_the_configuration_that_they_are_made_of_is_whole(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(WHOLE)
    assert load_settings(tmp_path / "a.yaml").experiment == "tiny"


@pytest.mark.parametrize("kind", ["device", "pipe", "folder"])
def test_what_is_no_file_is_never_read(kind: str, tmp_path: Path) -> None:
    path = {"device": Path("/dev/zero"), "pipe": tmp_path / "pipe", "folder": tmp_path}[kind]
    if kind == "pipe":
        os.mkfifo(path)
    with pytest.raises(LdsimError, match="is no file"):
        resolve_path(str(path), Path())
    with pytest.raises(LdsimError, match="is no file"):
        read_recording(path, "a")
    with pytest.raises(SettingsError, match="is a folder" if kind == "folder" else "does not exist"):
        load_settings(path)


@pytest.mark.parametrize("size", [1e10, 1e150, 1e300])
def test_a_surface_of_the_size_of_a_planet_is_refused(size: float, tmp_path: Path) -> None:
    from ldsim.mesh.formats import read_surface
    from ldsim.mesh.repair import repaired

    path = tmp_path / "a.off"
    path.write_text(f"OFF\n4 4 0\n0 0 0\n{size} 0 0\n0 {size} 0\n0 0 {size}\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n")
    with pytest.raises(LdsimError, match="of at most 1e"):
        repaired(read_surface(path))
