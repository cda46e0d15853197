"""`ldsim make`: what it judges stale, and why, by what the artefacts say (what it runs: tests/test_make.py)."""

from __future__ import annotations

import copy
import shutil
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from ldsim.learn.options import TrainOptions
from ldsim.pipeline.convergence import Round, write_rounds
from ldsim.settings import STAGES, load_settings, make
from ldsim.settings.make import changed_settings
from tests.cli.experiments import TINY, WRITES, Experiment, refused
from tests.helpers import changed as changed_file


def stale(experiment: Experiment, *arguments: str) -> dict[str, str]:
    """The stages that would run, each with the reason."""
    result = experiment.invoke("make", "--dry-run", *arguments)
    assert result.exit_code == 0, result.output
    return dict(line.split(": ", 1) for line in result.stdout.splitlines())  # type: ignore[misc]


def after(stage: str) -> list[str]:
    return list(STAGES[STAGES.index(stage) :])


def test_a_finished_run_is_up_to_date_and_says_so(experiment: Experiment) -> None:
    assert stale(experiment) == {}
    result = experiment.invoke("make")
    page = (experiment.run / "report" / "report.html").resolve()
    assert result.stdout == f"nothing to do, tiny is up to date: {page}\n"


def test_times_copies_and_comments_make_nothing_stale(experiment: Experiment) -> None:
    for name in WRITES.values():
        (experiment.run / name).touch()
    experiment.config.write_text(f"# a comment\n{experiment.config.read_text('utf-8')}", encoding="utf-8")
    shutil.copytree(experiment.run, experiment.folder / "copies" / "tiny")
    assert stale(experiment, "--runs", str(experiment.folder / "copies")) == {}


def test_looking_at_the_solid_again_makes_nothing_stale(experiment: Experiment) -> None:
    scene = experiment.folder / "runs" / "tiny" / "scene.h5"
    before = scene.read_bytes()
    looked = experiment.invoke("mesh")
    assert looked.exit_code == 0 and "vertices pinned" in looked.output and "is left as it is" in looked.output
    assert scene.read_bytes() == before and not stale(experiment)
    scene.write_bytes(before[:-1])
    assert experiment.invoke("mesh").exit_code == 0 and scene.stat().st_size >= len(before)


def test_a_setting_equal_to_its_default_makes_nothing_stale(experiment: Experiment) -> None:
    experiment.change("train.learning_rate", TrainOptions().learning_rate)
    assert stale(experiment) == {}


@pytest.mark.parametrize(
    ("stage", "key", "value"),
    [
        ("mesh", "mesh.density", 900.0),
        ("snapshot", "snapshot.tolerance", 1e-5),
        ("pca", "pca.k", 5),
        ("train", "train.learning_rate", 1e-3),
        ("cubature", "cubature.virtual.steps", 50),
        ("simulate", "simulate.max_iterations", 100),
        ("report", "report.pictures", False),
    ],
)
def test_a_setting_makes_its_stage_and_what_follows_stale(
    experiment: Experiment, stage: str, key: str, value: object
) -> None:
    experiment.change(key, value)
    found = stale(experiment)
    assert list(found) == after(stage)
    assert found[stage] == f"{key.split('.', 1)[1]} changed"
    assert all("comes before it" in found[later] for later in after(stage)[1:])


@pytest.mark.parametrize(("key", "value"), [("workers", 2), ("linear_solver", "multigrid")])
def test_how_much_memory_runs_may_take_makes_nothing_stale(experiment: Experiment, key: str, value: object) -> None:
    experiment.change(f"snapshot.{key}", value)
    assert stale(experiment) == {}


def test_a_stage_that_a_signal_ends_is_told(experiment: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    """As Linux ends what takes more memory than there is; the stage itself cannot say so any more."""
    monkeypatch.setattr(make, "status_of", lambda command: -signal.SIGKILL)
    experiment.change("train.learning_rate", 1e-3)
    result = experiment.invoke("make")
    assert result.exit_code == 1
    assert "train was ended by signal 9, as the system ends what takes too much memory" in result.output


def test_who_ends_make_ends_its_stage_too(experiment: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    """`kill` reaches the command alone."""
    notes = list[str]()

    class Stage:
        def __init__(self, command: list[str]) -> None:
            pass

        def wait(self) -> None:
            notes.append("waited")
            if len(notes) == 1:
                signal.raise_signal(signal.SIGTERM)
                pytest.fail("it went on waiting")

        def kill(self) -> None:
            notes.append("killed")

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(subprocess, "Popen", Stage)
    experiment.change("train.learning_rate", 1e-3)
    result = experiment.invoke("make")
    assert result.exit_code == 128 + signal.SIGTERM and signal.getsignal(signal.SIGTERM) is before
    assert notes == ["waited", "killed", "waited"]


@pytest.mark.parametrize("stage", WRITES)
def test_a_missing_artefact_is_made_again_with_what_follows(experiment: Experiment, stage: str) -> None:
    (experiment.run / WRITES[stage]).unlink()
    found = stale(experiment)
    assert found[stage] == f"{WRITES[stage]} is not there yet"
    assert list(found) == after(stage)


def test_a_missing_page_is_made_again(experiment: Experiment) -> None:
    (experiment.run / "report" / "report.html").unlink()
    assert list(stale(experiment)) == ["report"]
    assert stale(experiment, "--until", "simulate") == {}


def test_an_artefact_made_from_another_one_is_stale(experiment: Experiment) -> None:
    """Somebody ran one stage by hand: what follows no longer fits."""
    with changed_file(experiment.run / "basis.h5") as file:
        file["singular_values"][0] *= 1.001
    found = stale(experiment)
    assert list(found) == after("train")
    assert found["train"] == "it was made from another basis.h5"


def test_an_artefact_of_another_experiment_is_stale(experiment: Experiment) -> None:
    with changed_file(experiment.run / "scene.h5") as file:
        file.attrs["experiment"] = "other"
    assert stale(experiment)["mesh"] == "scene.h5 belongs to the experiment other"


def test_a_damaged_artefact_is_told_and_nothing_is_thrown_away(experiment: Experiment) -> None:
    path = experiment.run / "model.h5"
    path.write_bytes(path.read_bytes()[:-100])
    before = experiment.finished()
    assert "model.h5" in refused(experiment.invoke("make"))
    assert experiment.finished() == before


def test_a_configuration_of_another_experiment_is_refused(experiment: Experiment) -> None:
    refusal = refused(experiment.invoke("make", "--experiment", "other"))
    assert "experiment is 'tiny', expected 'other'" in refusal


def test_an_error_that_is_asked_for_is_compared_with_the_statement(experiment: Experiment) -> None:
    assert experiment.invoke("make", "--error", "1e6").exit_code == 0
    result = experiment.invoke("make", "--error", "0.001")
    assert result.exit_code == 3 and "asked were 0.001 %" in result.stderr
    told = experiment.invoke("make", "--error", "0.001", "--until", "train")
    assert told.exit_code == 0  # it does not make the report


def test_where_nothing_is_trained_no_round_runs_for_an_error(experiment: Experiment, tmp_path: Path) -> None:
    result = experiment.invoke("make", "--runs", str(tmp_path), "--error", "5", "--until", "mesh")
    assert result.exit_code == 0, result.output
    assert [path.name for path in (tmp_path / "tiny").glob("*.h5")] == ["scene.h5"]


def test_a_report_that_has_not_seen_the_last_rounds_is_made_anew(experiment: Experiment) -> None:
    write_rounds(experiment.run, [Round(error=0.1, pulls=3, seconds=2.0, changed="")])
    assert stale(experiment) == {"report": "there were more rounds of learning"}


def with_files(experiment: Experiment) -> None:
    """The same experiment with a mesh file and a recording, made anew up to the snapshots."""
    content: dict[str, Any] = copy.deepcopy(TINY)
    del content["mesh"]["shape"]
    content["mesh"]["file"] = "one.mesh"
    content["mesh"]["pins"] = [{"slab": {"axis": "y", "thickness": 0.2}}]
    content["snapshot"]["motions"] = [{"name": "a", "recording": "a.csv"}]
    (experiment.folder / "one.mesh").write_text(ONE, encoding="utf-8")
    (experiment.folder / "a.csv").write_text(RECORDING, encoding="utf-8")
    experiment.configure(content)
    for stage in ("mesh", "snapshot"):
        result = experiment.invoke(stage)
        assert result.exit_code == 0, result.output


ONE = """MeshVersionFormatted 2
Dimension 3
Vertices
5
0 0 0 0
1 0 0 0
0 0 1 0
0 1 0 0
1 1 1 0
Tetrahedra
2
1 3 2 4 0
2 3 5 4 0
End
"""
RECORDING = """# spring_stiffness_n_per_m: 30
# grab_radius_m: 0.03
is_dragging,target_x,target_y,target_z,grabbed_x,grabbed_y,grabbed_z
0,0,0,0,0,0,0
1,0,1.01,0,0,1,0
"""


@pytest.mark.parametrize(
    ("file", "edit", "expected"),
    [
        ("one.mesh", lambda text: text.replace("1 1 1 0", "1 1.1 1 0"), "mesh"),
        ("a.csv", lambda text: text.replace("1.01", "1.02"), "snapshot"),
        ("one.mesh", lambda text: text, None),
    ],
    ids=["mesh file", "recording", "touched"],
)
def test_what_a_stage_reads_from_outside_makes_it_stale(
    experiment: Experiment, file: str, edit: Callable[[str], str], expected: str | None
) -> None:
    with_files(experiment)
    assert stale(experiment, "--until", "snapshot") == {}
    path = experiment.folder / file
    path.write_text(edit(path.read_text("utf-8")), encoding="utf-8")
    found = stale(experiment, "--until", "snapshot")
    assert (found[expected] == f"{file} changed") if expected else not found


def test_a_test_motion_makes_stale_only_what_judges(experiment: Experiment) -> None:
    content = copy.deepcopy(TINY)
    pulls = {"count": 1, "seed": 3, "reach": 0.08, "frames": 12, "rest": 8}
    content["snapshot"]["motions"].append({"name": "c", "role": "test", "pulls": pulls})
    experiment.configure(content)
    assert list(stale(experiment)) == ["snapshot", "simulate", "report"]
    assert experiment.invoke("snapshot").exit_code == 0
    assert list(stale(experiment)) == ["simulate", "report"]
    assert experiment.invoke("simulate").exit_code == 0
    assert list(stale(experiment)) == ["report"]


def test_a_file_that_is_gone_is_named(experiment: Experiment) -> None:
    with_files(experiment)
    (experiment.folder / "a.csv").unlink()
    assert "a.csv does not exist" in refused(experiment.invoke("make", "-n"))


def test_settings_that_changed_are_named_by_their_keys(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(TINY), encoding="utf-8")
    settings = load_settings(tmp_path / "a.yaml").snapshot
    motion = settings.motions[0].replace(frames=3)
    other = settings.replace(workers=4, motions=(motion, settings.motions[1]))
    assert changed_settings(settings.dump(), other) == ["motions", "workers"]
    assert changed_settings(settings.dump(), settings) == ["settings"]
