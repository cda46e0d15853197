"""make builds what is missing or stale and nothing else, on the Makefile itself with the interpreter of the tests."""

from __future__ import annotations

import copy
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from ldsim.learn.options import TrainOptions
from tests.cli.experiments import COMMANDS, TINY, WRITES

ROOT = Path(__file__).parent.parent
CHAIN = ["mesh", "snapshot", "pca", "train", "cubature", "simulate", "report"]
# The report has its own tests; the chain up to it is what is made here.
LAST = "simulate"

pytestmark = [
    pytest.mark.skipif(shutil.which("make") is None, reason="needs make"),
    pytest.mark.skipif(not (ROOT / "Makefile").is_file(), reason="needs the source tree"),
]


class Project:
    """The experiment `tiny` in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.run = folder / "runs" / "tiny"
        self.config = folder / "tiny.yaml"

    def configure(self, comment: str = "", **sections: object) -> None:
        text = yaml.safe_dump(copy.deepcopy(TINY) | sections)
        self.config.write_text(f"{comment}{text}", encoding="utf-8")

    def make(self, *arguments: str, status: int = 0) -> str:
        """What make said on stdout."""
        variables = {
            "EXPERIMENT": "tiny",
            "CONFIG": str(self.config),
            "RUNS": str(self.folder / "runs"),
            "LDSIM": f"{sys.executable} -m ldsim",
            "ENVIRONMENT": "",
        }
        command = ["make", *(f"{name}={value}" for name, value in variables.items()), *arguments]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == status, done.stderr
        return done.stdout

    def stages(self, *arguments: str, status: int = 0) -> list[str]:
        """The stages that make started, or with -n would start."""
        lines = [line.split() for line in self.make(*arguments, status=status).splitlines()]
        calls = [words[words.index("ldsim") + 1] for words in lines if "-m" in words and "ldsim" in words]
        return [name for name in calls if name in CHAIN]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """The chain, made once from nothing."""
    project = Project(tmp_path_factory.mktemp("make"))
    project.configure()
    assert project.stages(LAST, "-j4") == CHAIN[:-1]
    return project


@pytest.fixture
def project(made: Project, tmp_path: Path) -> Project:
    """A copy of it, times included."""
    shutil.copytree(made.folder, tmp_path, dirs_exist_ok=True)
    return Project(tmp_path)


def test_a_second_make_starts_no_stage_and_says_so(project: Project) -> None:
    before = {path: path.stat().st_mtime_ns for path in project.run.rglob("*")}
    said = project.make(LAST)
    assert said == f"nothing to do, tiny is up to date: {project.run / WRITES[LAST]}\n"
    assert {path: path.stat().st_mtime_ns for path in project.run.rglob("*")} == before


def test_a_comment_makes_nothing_stale(project: Project) -> None:
    project.configure(comment="# a comment\n\n")
    assert project.stages(LAST) == []


def test_a_setting_equal_to_its_default_makes_nothing_stale(project: Project) -> None:
    project.configure(train=TINY["train"] | {"learning_rate": TrainOptions().learning_rate})
    assert project.stages(LAST) == []


@pytest.mark.parametrize(
    ("stage", "settings"),
    [
        ("mesh", {"density": 900.0}),
        ("snapshot", {"tolerance": 1e-5}),
        ("pca", {"k": 5}),
        ("train", {"learning_rate": 1e-3}),
        ("cubature", {"tolerance": 0.1}),
        ("simulate", {"max_iterations": 100}),
        ("report", {"pictures": 2}),
    ],
)
def test_a_setting_makes_its_stage_and_what_follows_stale(
    project: Project, stage: str, settings: dict[str, object]
) -> None:
    project.configure(**{stage: TINY[stage] | settings})
    expected = [name for name in CHAIN[CHAIN.index(stage) :] if name != "report"]
    assert project.stages("-n", LAST) == expected


def test_a_test_motion_makes_nothing_stale_but_the_simulation(project: Project) -> None:
    unseen = {"name": "c", "role": "test", "pulls": {"count": 1, "reach": 0.08, "frames": 12, "rest": 8}}
    project.configure(snapshot=TINY["snapshot"] | {"motions": [*TINY["snapshot"]["motions"], unseen]})
    assert project.stages("-n", LAST) == ["snapshot", "simulate"]


@pytest.mark.parametrize("stage", CHAIN[:-1])
def test_a_missing_artefact_is_made_again_with_what_follows(project: Project, stage: str) -> None:
    (project.run / WRITES[stage]).unlink()
    assert project.stages("-n", LAST) == CHAIN[CHAIN.index(stage) : -1]


def test_only_what_is_stale_runs(project: Project) -> None:
    before = {name: (project.run / name).read_bytes() for name in WRITES.values()}
    project.configure(train=TINY["train"] | {"learning_rate": 1e-3})
    assert project.stages(LAST) == ["train", "cubature", "simulate"]
    changed = {name for name in WRITES.values() if (project.run / name).read_bytes() != before[name]}
    assert changed == {"model.h5", "cubature.h5", "simulation.h5"}
    assert project.stages(LAST) == []


@pytest.mark.parametrize("stage", CHAIN)
def test_each_stage_is_a_goal_that_runs_what_comes_before(tmp_path: Path, stage: str) -> None:
    fresh = Project(tmp_path)
    fresh.configure()
    assert fresh.stages("-n", stage) == CHAIN[: CHAIN.index(stage) + 1]


def test_the_report_is_what_is_made_when_nothing_is_asked(tmp_path: Path) -> None:
    fresh = Project(tmp_path)
    fresh.configure()
    assert fresh.stages("-n") == CHAIN


def test_a_stage_that_fails_stops_make_and_leaves_nothing_half_made(project: Project) -> None:
    before = {name: (project.run / name).read_bytes() for name in WRITES.values()}
    project.configure(simulate={"motions": ["nobody"]})
    assert project.stages(LAST, status=2) == ["simulate"]
    assert {name: (project.run / name).read_bytes() for name in WRITES.values()} == before
    assert project.stages("-n", LAST) == ["simulate"]


def test_cubature_that_misses_its_tolerance_is_told_and_stops_nothing(project: Project) -> None:
    project.configure(cubature=TINY["cubature"] | {"tolerance": 1e-6, "max_points": 3})
    assert project.stages(LAST) == ["cubature", "simulate"]
    assert project.stages(LAST) == []


def test_a_bad_configuration_stops_make_before_any_stage(project: Project) -> None:
    project.configure(trian={})
    assert project.stages(LAST, status=2) == []


def test_a_configuration_of_another_experiment_is_refused(project: Project) -> None:
    project.configure(experiment="other")
    assert project.stages(LAST, status=2) == []
    assert not (project.folder / "runs" / "other").exists()


def test_help_lists_every_goal() -> None:
    said = subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    listed = {line.split()[0] for line in said.splitlines()[1:]}
    assert listed == {*CHAIN, "demo", "paper", "test", "lint", "bounds", "settings", "clean", "help"}


def test_the_tests_do_not_see_the_environment_of_who_runs_them() -> None:
    """As in a make that was started by another one, on an experiment of its own, in a narrow window."""
    callers = {"MAKEFLAGS": "w -- RUNS=elsewhere", "MAKELEVEL": "2", "LDSIM_DATA": "nowhere", "COLUMNS": "20"}
    test = f"{Path(__file__).relative_to(ROOT)}::{test_help_lists_every_goal.__name__}"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | callers, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_every_stage_has_its_fragment() -> None:
    assert {path.stem for path in (ROOT / "stages").glob("*.mk")} == set(CHAIN)
    assert set(COMMANDS) <= set(CHAIN)
