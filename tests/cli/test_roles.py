"""What may look at a motion: everything at one to train on, choices at one of validation, nothing at one of test."""

from __future__ import annotations

import copy
from typing import Any

import h5py
import pytest

from ldsim.run import Run
from tests.cli.experiments import TINY, Experiment, refusal

UNSEEN = {"name": "c", "role": "test", "pulls": {"count": 1, "seed": 3, "reach": 0.08, "frames": 12, "rest": 8}}
LEARNED = ("scene", "snapshots", "basis", "model", "cubature")


def with_motions(*motions: dict[str, Any]) -> dict[str, Any]:
    content = copy.deepcopy(TINY)
    content["snapshot"]["motions"] += motions
    return content


def done(experiment: Experiment, *commands: str) -> None:
    for command in commands:
        assert experiment.invoke(command).exit_code in (0, 3), command


@pytest.fixture
def tested(experiment: Experiment) -> Experiment:
    """The finished experiment with a test motion that was added to it."""
    experiment.configure(with_motions(UNSEEN))
    done(experiment, "snapshot", "simulate")
    return experiment


def test_a_test_motion_added_to_a_finished_run_runs_alone_and_makes_nothing_stale(
    experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran = list[str]()
    from ldsim.pipeline import snapshot

    run_motions = snapshot.run_motions
    monkeypatch.setattr(
        snapshot, "run_motions", lambda scene, folder, motions, *rest: (
            ran.extend(motion.name for motion in motions), run_motions(scene, folder, motions, *rest)
        )
    )  # fmt: skip
    before = {kind: (experiment.run / f"{kind}.h5").read_bytes() for kind in LEARNED}
    experiment.configure(with_motions(UNSEEN))
    done(experiment, "snapshot", "simulate", "report")
    assert ran == ["c"]
    assert {kind: (experiment.run / f"{kind}.h5").read_bytes() for kind in LEARNED} == before
    with Run.open(experiment.run) as run:
        run.require(*LEARNED, "tests", "simulation")
        assert list(run.motions) == ["a", "b", "c"] and run.recorded("c").role == "test"
        assert run.snapshots.names == ["a", "b"]
        assert set(run.simulation["latent"]) == set(run.simulation["linear"]) == {"a", "b", "c"}


def test_nothing_before_simulate_reads_a_test_motion(tested: Experiment) -> None:
    """The file of test motions may be anything then; simulate refuses it."""
    done(tested, "train", "cubature")
    before = {kind: (tested.run / f"{kind}.h5").stat().st_mtime_ns for kind in LEARNED}
    (tested.run / "tests.h5").write_bytes(b"no artefact")
    done(tested, "pca", "train", "cubature")
    assert all((tested.run / f"{kind}.h5").stat().st_mtime_ns > before[kind] for kind in LEARNED[2:])
    assert "tests.h5 is not a readable HDF5 file" in refusal(tested, "simulate")


def test_a_stage_that_has_nothing_to_run_leaves_both_files_alone(experiment: Experiment) -> None:
    """Also where no motion has the role test."""
    files = [experiment.run / f"{kind}.h5" for kind in ("snapshots", "tests")]
    before = [file.read_bytes() for file in files]
    done(experiment, "snapshot")
    assert [file.read_bytes() for file in files] == before


def test_a_training_motion_that_is_added_runs_alone_too(tested: Experiment) -> None:
    other = UNSEEN | {"name": "d", "role": "train"}
    tested.configure(with_motions(UNSEEN, other))
    with h5py.File(tested.run / "snapshots.h5") as file:
        before = {name: group["seconds"][:].tolist() for name, group in file["motions"].items()}
    done(tested, "snapshot")
    with h5py.File(tested.run / "snapshots.h5") as file:
        after = {name: group["seconds"][:].tolist() for name, group in file["motions"].items()}
    assert before == {name: after[name] for name in before} and set(after) == {*before, "d"}


def test_a_motion_that_changed_its_role_is_not_run_again(tested: Experiment) -> None:
    with h5py.File(tested.run / "tests.h5") as file:
        seconds = file["motions/c/seconds"][:].tolist()
    tested.configure(with_motions(UNSEEN | {"role": "validation"}))
    done(tested, "snapshot")
    with h5py.File(tested.run / "snapshots.h5") as file:
        assert file["motions/c/seconds"][:].tolist() == seconds
    with h5py.File(tested.run / "tests.h5") as file:
        assert "motions" not in file


def test_a_motion_that_changed_is_run_again(tested: Experiment) -> None:
    with h5py.File(tested.run / "tests.h5") as file:
        before = file["motions/c/displacements"][:]
    tested.configure(with_motions(UNSEEN | {"pulls": UNSEEN["pulls"] | {"seed": 4}}))  # type: ignore[operator]
    done(tested, "snapshot")
    with h5py.File(tested.run / "tests.h5") as file:
        assert (file["motions/c/displacements"][:] != before).any()
