"""Every kind of artefact: what is written is read back, what is damaged is refused in one line, and a failed write
leaves the artefact that was there."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from ldsim.artefacts import atomic, partial, store
from ldsim.artefacts.schema import SCHEMA_VERSION, SCHEMAS
from ldsim.artefacts.sealed_file import UnreadableError, datasets, opened
from ldsim.artefacts.store import Header, file_hash
from ldsim.artefacts.training import TrainingStore
from ldsim.errors import ArtefactError
from ldsim.mechanics.motion import Motion
from ldsim.run import Run
from tests.artefacts.examples import EXAMPLES, Example, same
from tests.helpers import changed, full_disk

HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"

every_kind = pytest.mark.parametrize("kind", EXAMPLES)


def header(kind: str) -> Header:
    notes = {"experiment": "e", "seconds": 1.5, "order": 3, "activation": "tanh"}
    return Header(kind, "a: 1\nb: größer\n", {"scene": "0" * 64}, 7, notes)


@pytest.fixture
def artefact(kind: str, tmp_path: Path) -> Path:
    path = tmp_path / "run" / f"{kind}.h5"
    EXAMPLES[kind].write(path, header(kind))
    return path


def refusal(example: Example, path: Path) -> str:
    with pytest.raises(ArtefactError) as caught:
        example.read(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


def test_every_kind_of_the_schema_has_an_example() -> None:
    assert set(EXAMPLES) == set(SCHEMAS)


@every_kind
def test_what_is_written_is_read_back(kind: str, artefact: Path) -> None:
    value, found = EXAMPLES[kind].read(artefact)
    assert same(value, EXAMPLES[kind].value)
    expected = header(kind)
    assert (found.kind, found.settings, found.inputs, found.seed) == (
        expected.kind,
        expected.settings,
        expected.inputs,
        expected.seed,
    )
    assert found.notes == expected.notes | ({"inner_product": "mass"} if kind == "basis" else {})
    assert found.ldsim_version
    assert found.created


@every_kind
def test_the_file_is_plain_hdf5_beside_which_nothing_is_left(kind: str, artefact: Path) -> None:
    with h5py.File(artefact, "r") as file:
        assert file.attrs["kind"] == kind
        assert all(data.dtype.kind in "fib" for data in datasets(file).values())
    assert [path.name for path in artefact.parent.iterdir() if not path.is_dir()] == [artefact.name]


@every_kind
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_a_truncated_file_is_refused(kind: str, artefact: Path, share: float) -> None:
    os.truncate(artefact, int(share * artefact.stat().st_size))
    assert "not a readable HDF5 file" in refusal(EXAMPLES[kind], artefact)


@every_kind
@pytest.mark.parametrize("content", [b"MeshVersionFormatted 1\n", HDF5_MAGIC, HDF5_MAGIC + b"\xff" * 4096])
def test_a_foreign_file_is_refused(kind: str, artefact: Path, content: bytes) -> None:
    artefact.write_bytes(content)
    assert "not a readable HDF5 file" in refusal(EXAMPLES[kind], artefact)


@every_kind
def test_a_foreign_hdf5_file_is_refused(kind: str, artefact: Path) -> None:
    with h5py.File(artefact, "w") as file:
        file["U"] = np.eye(3)
    assert "is not an ldsim artefact" in refusal(EXAMPLES[kind], artefact)
    with h5py.File(artefact, "w", userblock_size=512) as file:
        file["U"] = np.eye(3)
    with changed(artefact):
        pass
    assert "lacks the attribute 'kind'" in refusal(EXAMPLES[kind], artefact)


@every_kind
def test_a_missing_file_is_refused_with_the_stage_that_makes_it(kind: str, tmp_path: Path) -> None:
    message = refusal(EXAMPLES[kind], tmp_path / "nothing.h5")
    stages = {
        "scene": "mesh",
        "snapshots": "snapshot",
        "tests": "snapshot",
        "basis": "pca",
        "model": "train",
        "simulation": "simulate",
    }
    assert f"does not exist; run `ldsim {stages.get(kind, kind)}` first" in message


@every_kind
@pytest.mark.parametrize("other", EXAMPLES)
def test_an_artefact_of_another_kind_is_refused(kind: str, other: str, artefact: Path, tmp_path: Path) -> None:
    if kind != other:
        EXAMPLES[other].write(artefact, header(other))
        assert f"holds {other!r}; expected {kind!r}" in refusal(EXAMPLES[kind], artefact)


@every_kind
@pytest.mark.parametrize("version", [SCHEMA_VERSION + 1, SCHEMA_VERSION - 1, "two"])
def test_another_schema_version_is_refused(kind: str, artefact: Path, version: object) -> None:
    with changed(artefact) as file:
        file.attrs["schema_version"] = version
    assert f"schema version {version}" in refusal(EXAMPLES[kind], artefact)


def names_of(artefact: Path) -> list[str]:
    with h5py.File(artefact, "r") as file:
        return list(datasets(file))


def refusals(change: Callable[[h5py.File, str], None], kind: str, artefact: Path, names: list[str]) -> dict[str, str]:
    """What is said of an artefact where one of these datasets alone is changed."""
    whole = artefact.read_bytes()
    found: dict[str, str] = {}
    for name in names:
        artefact.write_bytes(whole)
        with changed(artefact) as file:
            change(file, name)
        found[name] = refusal(EXAMPLES[kind], artefact)
    return found


def as_text(file: h5py.File, name: str) -> None:
    shape = file[name].shape
    del file[name]
    file.create_dataset(name, shape, "S3")


def with_another_axis(file: h5py.File, name: str) -> None:
    values = file[name][()]
    del file[name]
    file[name] = values[..., None]


@every_kind
@pytest.mark.parametrize(
    ("change", "words"), [(as_text, "found type |S3, expected"), (with_another_axis, "found shape")]
)
def test_a_dataset_of_the_wrong_type_or_shape_is_refused(
    kind: str, artefact: Path, change: Callable[[h5py.File, str], None], words: str
) -> None:
    for name, message in refusals(change, kind, artefact, names_of(artefact)).items():
        assert name in message and words in message


@every_kind
def test_a_dataset_that_must_be_there_is_missed(kind: str, artefact: Path) -> None:
    optional = {entry.path.rpartition("/")[2] for entry in SCHEMAS[kind] if entry.optional}
    # One of several layers is missed only by the arithmetic of the network, tested below.
    layers = {"weights_0", "weights_1", "biases_0", "biases_1"}
    names = [name for name in names_of(artefact) if name.rpartition("/")[2] not in optional | layers]
    for name, message in refusals(h5py.File.__delitem__, kind, artefact, names).items():
        assert f"lacks the dataset {name!r}" in message


@pytest.mark.parametrize("kind", ["model"])
@pytest.mark.parametrize("name", ["decoder/weights_0", "decoder/biases_1", "encoder/weights_1", "encoder/biases_0"])
def test_a_network_without_one_of_its_layers_is_refused(kind: str, artefact: Path, name: str) -> None:
    with changed(artefact) as file:
        del file[name]
    assert "is damaged" in refusal(EXAMPLES[kind], artefact)


@pytest.mark.parametrize("kind", ["basis"])
def test_sizes_that_do_not_fit_each_other_are_refused(kind: str, artefact: Path) -> None:
    with changed(artefact) as file:
        del file["mean_error"]
        file["mean_error"] = np.ones(9)
    assert "dataset 'mean_error': found shape (9,), expected (e) with e = 4" in refusal(EXAMPLES[kind], artefact)


@every_kind
def test_a_dataset_that_no_schema_knows_is_refused(kind: str, artefact: Path) -> None:
    with changed(artefact) as file:
        file["surprise"] = 1.0
    assert "'surprise'" in refusal(EXAMPLES[kind], artefact)


def test_an_input_that_is_not_the_one_read_is_refused(tmp_path: Path) -> None:
    scene, basis = tmp_path / "scene.h5", tmp_path / "basis.h5"
    EXAMPLES["scene"].write(scene, replace(header("scene"), inputs={}))
    EXAMPLES["basis"].write(basis, replace(header("basis"), inputs={"scene": file_hash(scene)}))
    Run(tmp_path, "e").require("basis", "scene")
    with changed(scene) as file:
        file["gravity"][1] = -1.0
    with pytest.raises(ArtefactError, match=r"basis\.h5 was made from another scene than .*scene\.h5"):
        Run(tmp_path, "e").require("basis", "scene")


# Failed writes


def no_space(*_: object, **__: object) -> Any:
    raise OSError(errno.ENOSPC, "no space")


@every_kind
def test_a_write_that_fails_at_the_end_leaves_the_artefact_that_was_there(
    kind: str, artefact: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = artefact.read_bytes()
    monkeypatch.setattr(atomic.os, "replace", no_space)
    with pytest.raises(ArtefactError, match="cannot write .*No space left on device"):
        EXAMPLES[kind].write(artefact, header(kind))
    assert artefact.read_bytes() == before
    assert not list(artefact.parent.glob(".*"))


@every_kind
@pytest.mark.parametrize("kibibytes", [0, 1, 4])
def test_a_disk_that_is_full_before_the_file_is_whole_costs_one_line(kind: str, artefact: Path, kibibytes: int) -> None:
    before = artefact.read_bytes()
    with full_disk(1024 * kibibytes), pytest.raises(ArtefactError, match="cannot write ") as caught:
        EXAMPLES[kind].write(artefact, header(kind))
    assert "\n" not in str(caught.value)
    assert artefact.read_bytes() == before
    assert not list(artefact.parent.glob(".*"))


@every_kind
def test_a_folder_that_cannot_be_made_costs_one_line(kind: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ArtefactError, match=r"cannot write .*(Not a directory|File exists)"):
        EXAMPLES[kind].write(tmp_path / "file" / "run.h5", header(kind))


@every_kind
def test_an_interrupted_write_leaves_the_artefact_that_was_there(
    kind: str, artefact: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = artefact.read_bytes()

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(store, "check_datasets", interrupt)
    monkeypatch.setattr(partial, "check_datasets", interrupt)
    with pytest.raises(KeyboardInterrupt):
        EXAMPLES[kind].write(artefact, header(kind))
    assert artefact.read_bytes() == before
    assert not list(artefact.parent.glob(".*"))


def test_values_that_do_not_fit_the_schema_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(ArtefactError, match="dataset 'U': found type float32, expected float64"):
        store.write(tmp_path / "basis.h5", header("basis"), {"U": np.eye(3, dtype=np.float32)})
    assert not list(tmp_path.iterdir())


@every_kind
def test_what_a_killed_writer_left_is_removed_by_the_next(kind: str, artefact: Path) -> None:
    ours, dead = (
        artefact.with_name(f".{artefact.name}.{atomic.HOST}-{number}.partial") for number in (os.getpid(), 2**22 + 1)
    )
    dead.write_bytes(b"half a file")
    living = artefact.with_name(f".{artefact.name}.{atomic.HOST}-{os.getppid()}.partial")
    living.write_bytes(b"somebody is writing")
    EXAMPLES[kind].write(artefact, header(kind))
    assert not dead.exists()
    assert not ours.exists()
    assert living.read_bytes() == b"somebody is writing"


def refusing(*_: object) -> None:
    raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def test_a_file_that_may_not_be_read_is_not_called_damaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    EXAMPLES["scene"].write(tmp_path / "scene.h5", header("scene"))
    monkeypatch.setattr("ldsim.artefacts.sealed_file.check_seal", refusing)
    with pytest.raises(UnreadableError, match=r"scene.h5 cannot be read: Permission denied$"):
        EXAMPLES["scene"].read(tmp_path / "scene.h5")


def test_a_checkpoint_that_may_not_be_read_costs_no_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = partial.MotionStore(tmp_path, Motion("m", 1))
    motion.append(np.zeros((2, 3)))
    motion.write_checkpoint(partial.Checkpoint("this", {}, {}, {}, np.zeros(1)))
    monkeypatch.setattr("ldsim.artefacts.sealed_file.check_seal", refusing)
    with pytest.raises(UnreadableError):
        motion.read_checkpoint("this", 24)
    assert (tmp_path / "m.frames").stat().st_size == 24


def test_a_training_that_may_not_be_read_is_not_begun_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = TrainingStore(tmp_path, "r4", "this")
    store.save({"mean": np.zeros(2)})
    monkeypatch.setattr("ldsim.artefacts.sealed_file.check_seal", refusing)
    with pytest.raises(UnreadableError):
        store.load()


def test_an_artefact_is_on_the_disk_before_it_takes_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = list[list[str]]()
    monkeypatch.setattr(os, "fsync", lambda file: names.append([each.name for each in tmp_path.glob("*.h5")]))
    EXAMPLES["scene"].write(tmp_path / "scene.h5", header("scene"))
    assert names and not any("scene.h5" in each for each in names)


@every_kind
@pytest.mark.parametrize("locking", [None, False])
def test_what_this_process_has_open_already_can_be_read(kind: str, artefact: Path, locking: bool | None) -> None:
    with h5py.File(artefact, "r", locking=locking):
        assert same(EXAMPLES[kind].read(artefact)[0], EXAMPLES[kind].value)
    with contextlib.ExitStack() as stack:
        stack.enter_context(opened(artefact))
        stack.enter_context(h5py.File(artefact, "r"))


@every_kind
@pytest.mark.parametrize("lock", [fcntl.LOCK_SH, fcntl.LOCK_EX], ids=["shared", "exclusive"])
def test_what_another_program_has_locked_can_be_read(kind: str, artefact: Path, lock: int) -> None:
    """As HDF5 does in a program that has it open: the lock is one of the open file, not of the process."""
    with artefact.open("rb") as stream:
        fcntl.flock(stream, lock)
        assert same(EXAMPLES[kind].read(artefact)[0], EXAMPLES[kind].value)


def test_what_is_locked_for_now_is_not_called_damaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def locked(*_: object, **__: object) -> None:
        raise BlockingIOError(errno.EAGAIN, "unable to lock file")

    EXAMPLES["scene"].write(tmp_path / "scene.h5", header("scene"))
    monkeypatch.setattr("ldsim.artefacts.sealed_file.h5py.File", locked)
    with pytest.raises(UnreadableError, match=r"scene.h5 cannot be read: Resource temporarily unavailable$"):
        EXAMPLES["scene"].read(tmp_path / "scene.h5")


def test_what_another_program_is_writing_is_said_to_be_that_perhaps(tmp_path: Path) -> None:
    path = tmp_path / "scene.h5"
    EXAMPLES["scene"].write(path, header("scene"))
    with h5py.File(path, "r+") as file:
        file["gravity"][1] = -1.0
        file.flush()
        assert "is damaged, or another program has it open to write (" in refusal(EXAMPLES["scene"], path)


@pytest.mark.parametrize("name", ["other", "linear_x", "linear_0"])
def test_rules_of_what_is_no_space_are_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "cubature.h5"
    EXAMPLES["cubature"].write(path, header("cubature"))
    with changed(path) as file:
        file.copy("linear", name)
    assert f"has rules of {name!r}, which is no space" in refusal(EXAMPLES["cubature"], path)
