"""Snapshots and settings from which no basis, model or cubature can be made: one line each."""

from __future__ import annotations

import json
from collections.abc import Callable

import h5py
import numpy as np
import pytest

from ldsim.artefacts.sealed_file import datasets
from ldsim.artefacts.store import file_hash
from tests.cli.experiments import TINY, Experiment, change, refusal
from tests.helpers import changed

# Basis and model


def snapshots_of(value: float, everywhere: bool) -> Callable[[Experiment], None]:
    """Put a value into one displacement of the training motion, or into all."""

    def spoil(experiment: Experiment) -> None:
        with changed(experiment.run / "snapshots.h5") as file:
            data = file["motions/a/displacements"]
            if everywhere:
                data[:] = value
            else:
                data[7, 0, 0] = value

    return spoil


SPACES: dict[str, tuple[str, Callable[[Experiment], None], str]] = {
    "k above the frames": ("pca", change("pca.k", 500), "k = 500 but there are only 40 training snapshots"),
    "NaN in a snapshot": ("pca", snapshots_of(np.nan, everywhere=False), "training snapshot 7 holds a displacement"),
    "constant data": ("pca", snapshots_of(0.0, everywhere=True), "nothing moves"),
    "a k out of reach": (
        "pca",
        lambda experiment: experiment.configure(
            TINY | {"pca": {"criterion": "max_error", "max_k": 1, "tolerance_mm": 1e-6}}
        ),
        "raise pca.max_k or pca.tolerance_mm",
    ),
    "r above k": ("train", change("train.r", 9), "train.r is 9; allowed are 1 … 6, the columns of the basis"),
    "an r out of reach": (
        "train",
        lambda experiment: experiment.configure(
            TINY | {"train": {"kind": "autoencoder", "tolerance_mm": 1e-9, "hidden": [8], "epochs": 2}}
        ),
        "raise train.tolerance_mm or pca.k",
    ),
    "an unknown device": ("train", change("train.device", "gpu"), "train.device: string should match pattern"),
}


@pytest.mark.parametrize("case", SPACES)
def test_a_space_that_cannot_be_found(experiment: Experiment, case: str) -> None:
    command, spoil, words = SPACES[case]
    spoil(experiment)
    assert words in refusal(experiment, command)


def test_no_motion_to_be_judged_on_is_said_in_one_line(experiment: Experiment) -> None:
    with changed(experiment.run / "snapshots.h5") as file:
        file["motions/b"].attrs["role"] = "train"
    assert experiment.invoke("pca").exit_code == 0
    result = experiment.invoke("train")
    assert result.exit_code == 0
    warnings = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    assert warnings == [
        "warning: no motion has the role validation, so choices and thresholds rest on the training motions"
    ]


def test_an_interrupted_pca_goes_on_where_it_was(experiment: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    path = experiment.run / "basis.h5"
    with h5py.File(path) as file:
        whole = {name: file[name][()] for name in datasets(file)}
    path.unlink()

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("ldsim.space.pca.leading_modes", interrupted)
        assert experiment.invoke("pca").exit_code != 0
    assert not path.exists()
    with monkeypatch.context() as patch:
        patch.setattr("ldsim.space.pca.gram_matrix", interrupted)
        assert experiment.invoke("pca").exit_code == 0
    with h5py.File(path) as file:
        for name, values in whole.items():
            np.testing.assert_array_equal(file[name][()], values)
    assert not (experiment.run / "basis.partial").exists()


# Cubature


def test_poses_without_any_force(experiment: Experiment) -> None:
    with changed(experiment.run / "snapshots.h5") as file:
        for motion in file["motions"].values():
            motion["displacements"][:] = 0.0
    hashes = {"snapshots": file_hash(experiment.run / "snapshots.h5")}
    for name in ("basis", "model"):
        with changed(experiment.run / f"{name}.h5") as file:
            file.attrs["inputs"] = json.dumps(json.loads(file.attrs["inputs"]) | hashes)
        hashes[name] = file_hash(experiment.run / f"{name}.h5")
    assert "the elastic force of all 20 poses is zero" in refusal(experiment, "cubature")


def test_a_model_of_another_scene(experiment: Experiment) -> None:
    with changed(experiment.run / "scene.h5") as file:
        file["material/mu"][:] *= 2
    assert "scene.h5" in refusal(experiment, "cubature")
