"""Bad input costs every command one line and exit status 1, and never a finished artefact.

What only one stage reads has a file of its own: test_bad_mesh.py, test_bad_motion.py, test_bad_space.py.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
import yaml

from tests.cli.experiments import COMMANDS, READS, TINY, WRITES, Experiment, change, invoked, refusal, refused
from tests.cli.spoiled import ARTEFACTS
from tests.helpers import full_disk, little_memory

every_command = pytest.mark.parametrize("command", COMMANDS)

# The configuration


def condensed(section: str, **changes: object) -> Callable[[Experiment], None]:
    """A configuration of a condensed space, with changes of one section."""

    def configure(experiment: Experiment) -> None:
        content = TINY | {"train": {"kind": "condensed", "r": 3}}
        experiment.configure(content | {section: content[section] | changes})

    return configure


def write(content: bytes) -> Callable[[Experiment], None]:
    return lambda experiment: experiment.config.write_bytes(content) and None


CONFIGURATIONS: dict[str, tuple[Callable[[Experiment], object], str]] = {
    "missing": (lambda experiment: experiment.config.unlink(), "does not exist"),
    "empty": (write(b""), "is empty"),
    "not YAML": (write(b"mesh: [1,\n  2\n"), "is not valid YAML"),
    "binary": (write(b"\x00\xff\xfe"), "is not valid YAML"),
    "a list": (write(b"- mesh\n"), "expected a mapping"),
    "an unknown section": (lambda experiment: experiment.configure(TINY | {"meshh": {}}), "did you mean 'mesh'?"),
    "an unknown key": (change("train.epoch", 1), "unknown key 'train.epoch'; did you mean 'epochs'?"),
    "a wrong type": (change("train.epochs", "many"), "train.epochs: input should be a valid integer"),
    "out of range": (change("train.learning_rate", 2.0), "train.learning_rate: input should be less than 1, got 2"),
    "a key missing": (change("mesh.material.youngs_modulus", ...), "mesh.material.youngs_modulus is missing"),
    "a motion that is not there": (change("simulate.motions", ["nobody"]), "simulate.motions names 'nobody'"),
    "condensed, quasi-static": (condensed("snapshot", quasistatic=True), "snapshot.quasistatic is true"),
    "condensed, no mass": (condensed("pca", inner_product="euclidean"), "it needs pca.inner_product: mass"),
    "condensed, too many": (condensed("train", r=7), "train.r is 7; allowed are 1 … 6"),
    "no motion": (change("simulate.motions", []), "simulate.motions: give at least 1"),
    "a folder": (lambda experiment: experiment.config.unlink() or experiment.config.mkdir(), "is a folder"),
    "two sources": (change("mesh.file", "x.mesh"), "mesh: give exactly one of file, shape, surface"),
}


@every_command
@pytest.mark.parametrize("case", CONFIGURATIONS)
def test_a_bad_configuration(experiment: Experiment, command: str, case: str) -> None:
    spoil, words = CONFIGURATIONS[case]
    spoil(experiment)
    message = refusal(experiment, command)
    assert words in message
    assert "tiny.yaml" in message


def test_each_of_several_faults_has_a_line_of_its_own(experiment: Experiment) -> None:
    change("train.epoch", 1)(experiment)
    experiment.configure(yaml.safe_load(experiment.config.read_text("utf-8")) | {"meshh": {}})
    first, *faults = refusal(experiment, "mesh").split("\n")
    assert first.endswith("tiny.yaml: 2 things are wrong")
    assert faults == ["unknown key 'train.epoch'; did you mean 'epochs'?", "unknown key 'meshh'; did you mean 'mesh'?"]


@pytest.mark.parametrize("case", CONFIGURATIONS)
def test_a_bad_configuration_is_told_by_settings_and_make_too(experiment: Experiment, case: str) -> None:
    spoil, words = CONFIGURATIONS[case]
    spoil(experiment)
    for command in ("settings", "make"):
        assert words in refused(invoked(command, str(experiment.config)))


# The artefacts that a command reads


@pytest.mark.parametrize(("command", "file"), [(command, file) for command in COMMANDS for file in READS[command]])
@pytest.mark.parametrize("case", ARTEFACTS)
def test_a_bad_artefact(experiment: Experiment, command: str, file: str, case: str) -> None:
    spoil, words = ARTEFACTS[case]
    spoil(experiment.run / file)
    message = refusal(experiment, command)
    assert file in message
    assert any(word in message for word in words), message


@every_command
def test_a_configuration_under_another_name_does_not_take_the_artefacts_of_the_first(
    experiment: Experiment, command: str
) -> None:
    if READS[command]:
        experiment.change("experiment", "other")
        experiment.run.rename(experiment.run.with_name("other"))
        message = refused(experiment.invoke(command))
        assert "belongs to the experiment 'tiny', expected 'other'" in message


# Where the artefact goes


@every_command
def test_a_full_disk(experiment: Experiment, command: str) -> None:
    # with all motions there, or a scene that has not changed, there is nothing to write
    if command in ("mesh", "snapshot"):
        (experiment.run / WRITES[command]).unlink()
    with full_disk(2048):
        message = refusal(experiment, command)
    assert message.removeprefix("motion a: ").startswith("cannot write ")


@pytest.mark.parametrize("command", [command for command in COMMANDS if command in WRITES])
def test_a_name_that_cannot_be_written(experiment: Experiment, command: str) -> None:
    target = experiment.run / WRITES[command]
    target.unlink()
    (target / "in the way").mkdir(parents=True)
    message = refusal(experiment, command)
    assert message.startswith(f"cannot write {target}: ")


def test_a_folder_that_cannot_be_made(experiment: Experiment) -> None:
    in_the_way = experiment.folder / "file"
    in_the_way.touch()
    result = invoked("mesh", str(experiment.config), "--runs", str(in_the_way / "runs"))
    assert "cannot write " in refused(result)


# Memory


def test_a_mesh_that_does_not_fit_in_memory(experiment: Experiment) -> None:
    experiment.change("mesh.shape.resolution", 56)
    with little_memory(2**28):
        message = refusal(experiment, "mesh")
    assert message.startswith("ldsim mesh ran out of memory (Unable to allocate")
    assert "use a coarser mesh" in message


@every_command
def test_any_allocation_that_fails(experiment: Experiment, command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("ldsim.cli.stage.load_settings", fail)
    assert refusal(experiment, command).startswith(f"ldsim {command} ran out of memory (allocation failed)")


def test_a_tensor_that_does_not_fit_in_memory(experiment: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldsim.cli.stage.load_settings", lambda *_: torch.empty(2**58))
    message = refusal(experiment, "train")
    assert message.startswith("ldsim train ran out of memory (")
    assert "tried to allocate" in message


def test_an_error_of_ours_is_not_taken_for_lack_of_memory(
    experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("a mistake in the code")

    monkeypatch.setattr("ldsim.cli.stage.load_settings", fail)
    result = invoked("train", str(experiment.config))
    assert isinstance(result.exception, RuntimeError)


# info


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "does not exist"), (b"", "is not a readable HDF5 file"), (b"Vertices", "is not a readable HDF5 file")],
)
def test_info_of_what_is_no_artefact(tmp_path: Path, content: bytes | None, words: str) -> None:
    path = tmp_path / "a.h5"
    if content is not None:
        path.write_bytes(content)
    assert words in refused(invoked("info", str(path)))


def test_info_of_a_mesh_does_not_say_to_delete_it(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_text("solid")
    told = refused(invoked("info", str(tmp_path / "part.stl")))
    assert "delete" not in told and "give a run" in told


def test_info_of_a_foreign_hdf5_file(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["x"] = np.eye(2)
    assert "is not an ldsim artefact" in refused(invoked("info", str(path)))
