"""`ldsim train`: what a kill in the middle costs, and what the artefact tells of the search and of novelty."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from typing import Any

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from threadpoolctl import threadpool_limits

from ldsim.artefacts.sealed_file import datasets
from ldsim.cli.app import main
from ldsim.learn.options import TrainOptions
from ldsim.pipeline.train import train
from ldsim.run import Run
from tests.cli.experiments import TINY, Experiment
from tests.helpers import changed

SYNTHETIC = {"synthetic": {"count": 3, "reach": 0.08, "frames": 12, "rest": 8}}
LONG = TINY | {
    "train": {"kind": "autoencoder", "r": 3, "hidden": [8], "epochs": 6000, "batch": 4, "equilibrium": {"weight": 1.0}}
}


def weights(experiment: Experiment) -> list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    with h5py.File(experiment.run / "model.h5") as file:
        return [file[f"{part}/weights_{i}"][:] for part in ("decoder", "encoder") for i in range(2)]


def model(experiment: Experiment) -> dict[str, bytes]:
    """Every dataset of the model, byte for byte."""
    with h5py.File(experiment.run / "model.h5") as file:
        return {name: data[()].tobytes() for name, data in datasets(file).items()}


@pytest.mark.parametrize(
    ("pulls", "given"), [({}, {}), (SYNTHETIC, {"equilibrium": {"weight": 1.0}, "epochs": 30})], ids=["", "terms"]
)
def test_python_and_a_configuration_with_the_same_values_make_the_same_model(
    experiment: Experiment, pulls: dict[str, Any], given: dict[str, Any], capfd: pytest.CaptureFixture[str]
) -> None:
    values = TINY["train"] | given
    experiment.configure(TINY | {"pca": TINY["pca"] | pulls, "train": values})
    assert experiment.invoke("pca").exit_code == experiment.invoke("train").exit_code == 0
    written = model(experiment)
    (experiment.run / "model.h5").unlink()
    capfd.readouterr()
    with Run(experiment.run) as run:
        returned = train(run, TrainOptions(**values))
        np.testing.assert_array_equal(run.model.decoder.layers.weights, returned.decoder.layers.weights)
    assert capfd.readouterr() == ("", "")
    assert model(experiment) == written


def test_settings_without_effect_are_told_of(experiment: Experiment) -> None:
    note = "train.condensed has no effect: train.kind is autoencoder"
    for told in (False, True):
        if told:
            experiment.change("train.condensed", {"rounds": 1})
        assert (f"note: {note}\n" in experiment.invoke("train").stderr) is told
        result = CliRunner().invoke(main, ["settings", str(experiment.config)])
        assert (f"\n# note: {note}\n" in result.stdout) is told


def test_a_killed_training_goes_on_and_ends_as_an_undisturbed_one(experiment: Experiment) -> None:
    experiment.configure(LONG | {"train": LONG["train"] | {"epochs": 400}})
    assert experiment.invoke("train").exit_code == 0
    undisturbed = weights(experiment)
    (experiment.run / "model.h5").unlink()
    words = ["train", str(experiment.config), "--runs", str(experiment.folder / "runs")]
    quiet = subprocess.DEVNULL
    process = subprocess.Popen([sys.executable, "-m", "ldsim", *words], stdout=quiet, stderr=quiet)
    checkpoint = experiment.run / "model.partial" / "r3.checkpoint.h5"
    while process.poll() is None and not checkpoint.is_file():
        time.sleep(0.01)
    assert process.poll() is None, "the training ended before it could be killed"
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (experiment.run / "model.h5").exists()
    assert experiment.invoke("train").exit_code == 0
    for ours, theirs in zip(weights(experiment), undisturbed, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert not checkpoint.exists()


def test_a_search_leaves_its_table_in_the_artefact(experiment: Experiment) -> None:
    experiment.configure(
        TINY | {"train": {"kind": "autoencoder", "tolerance_mm": 30.0, "hidden": [8], "epochs": 200, "batch": 16}}
    )
    assert experiment.invoke("train").exit_code == 0
    with h5py.File(experiment.run / "model.h5") as file:
        table, own = file["search"][:], file["search_own"][:]
        r = file["decoder/weights_0"].shape[0]
    assert table[0, 0] == 6
    assert not own[0]
    assert r in table[:, 0]
    assert own.sum() <= 2


def test_simulate_records_the_novelty_score_and_warns_where_it_is_high(experiment: Experiment) -> None:
    with h5py.File(experiment.run / "simulation.h5") as file:
        scores = file["runs/latent/b/novelty"][:]
        assert "novelty" not in file["runs/linear/b"]
    assert len(scores) == 20
    assert (scores[np.isfinite(scores)] >= 0).all()
    with changed(experiment.run / "model.h5") as file:
        file["novelty/threshold"][...] = 1e-9
    assert experiment.invoke("cubature").exit_code in (0, 3)
    result = experiment.invoke("simulate")
    assert result.exit_code == 0
    with h5py.File(experiment.run / "simulation.h5") as file:
        runs = {name: file["runs/latent"][name] for name in file["runs/latent"]}
        errors = {name: each["mean_error"][:].sum() / each["mean_displacement"][:].sum() for name, each in runs.items()}
    for name, error in errors.items():
        told = f"{name} in the latent space: 20 of 20 frames are far from the training motions" in result.stderr
        assert told == (not error <= 0.1), (name, error)


def test_synthetic_motions_are_learned_from_and_fitted_to(experiment: Experiment) -> None:
    before = weights(experiment)
    experiment.configure(
        TINY | {"pca": TINY["pca"] | SYNTHETIC, "cubature": TINY["cubature"] | {"poses": 60, "heldout_poses": 30}}
    )
    assert experiment.invoke("pca").exit_code == experiment.invoke("train").exit_code == 0
    with h5py.File(experiment.run / "basis.h5") as file:
        synthetic = file["synthetic"][:]
    assert synthetic.shape == (60, 6)
    assert np.isfinite(synthetic).all()
    assert any((ours != theirs).any() for ours, theirs in zip(weights(experiment), before, strict=True))
    # the 40 frames of the snapshots alone would be too few
    assert experiment.invoke("cubature").exit_code in (0, 3)


@pytest.mark.parametrize(("most", "given", "made"), [(0, {}, 3), (1000, {}, 0), (0, {"k": 6}, 0)], ids=str)
def test_a_large_solid_learns_from_synthetic_pulls_like_its_own_where_all_is_left_open(
    experiment: Experiment, monkeypatch: pytest.MonkeyPatch, most: int, given: dict[str, int], made: int
) -> None:
    monkeypatch.setattr("ldsim.pipeline.pca.MANY", most)
    monkeypatch.setattr("ldsim.pipeline.pca.SYNTHETIC", 3)
    experiment.configure(TINY | {"pca": given})
    assert experiment.invoke("pca").exit_code == 0
    with Run(experiment.run) as run:
        assert (0 if run.pca.synthetic is None else len(run.pca.synthetic)) == made * 2 * 12  # frames of a pull of "a"


def test_synthetic_motions_are_not_run_again_after_an_interruption(
    experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment.configure(TINY | {"pca": TINY["pca"] | SYNTHETIC})
    assert experiment.invoke("pca").exit_code == 0
    undisturbed = basis(experiment)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("ldsim.pipeline.pca.turned", stop)
        assert experiment.invoke("pca").exit_code != 0
    monkeypatch.setattr("ldsim.pipeline.pca.synthetic_frames", stop)
    assert experiment.invoke("pca").exit_code == 0
    np.testing.assert_array_equal(basis(experiment), undisturbed)


def test_the_basis_is_the_same_to_the_last_bit_whatever_the_number_of_threads(experiment: Experiment) -> None:
    many = {"count": 2, "seed": 1, "reach": 0.08, "frames": 60, "rest": 40}  # BLAS shares out what is large enough
    solid = TINY["mesh"] | {"shape": {"name": "cross", "resolution": 2}}
    experiment.configure(TINY | {"mesh": solid, "snapshot": {"motions": [{"name": "a", "pulls": many}]}})
    assert experiment.invoke("mesh").exit_code == experiment.invoke("snapshot").exit_code == 0
    found = []
    for threads in (1, 2, 4):
        with threadpool_limits(threads):
            assert experiment.invoke("pca").exit_code == 0
        with h5py.File(experiment.run / "basis.h5") as file:
            found.append([file[name][:].tobytes() for name in ("U", "singular_values", "mean_error")])
    assert found[0] == found[1] == found[2]


def basis(experiment: Experiment) -> np.ndarray:
    with h5py.File(experiment.run / "basis.h5") as file:
        return np.hstack([file["U"][:].ravel(), file["synthetic"][:].ravel()])


def test_synthetic_motions_that_are_lost_are_said(experiment: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldsim.pipeline.pca.synthetic_frames", lambda *_: np.ones((7, 6)))
    experiment.configure(TINY | {"pca": TINY["pca"] | SYNTHETIC})
    result = experiment.invoke("pca")
    assert result.exit_code == 0
    assert "the synthetic motions diverged and lost 53 of 60 frames" in result.stderr
