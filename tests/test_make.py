"""make builds what is missing or stale and nothing else, on the Makefile itself with the interpreter of the tests."""

from __future__ import annotations

import copy
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml

from tests.cli.experiments import TINY, WRITES

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
        return self._made(arguments, status).stdout

    def refusal(self, *arguments: str) -> str:
        """What make said on stderr before it did anything."""
        return self._made(arguments, 2).stderr

    def _made(self, arguments: Sequence[str], status: int) -> subprocess.CompletedProcess[str]:
        variables = {
            "EXPERIMENT": "tiny",
            "CONFIG": str(self.config),
            "RUNS": str(self.folder / "runs"),
            "LDSIM": f"{sys.executable} -m ldsim",
            "ENVIRONMENT": "",
            "USED": "",
        }
        command = ["make", *(f"{name}={value}" for name, value in variables.items()), *arguments]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == status, done.stderr
        return done

    def stages(self, *arguments: str, status: int = 0) -> list[str]:
        """The stages that make started, or with -n would start."""
        names = [line.split(": ")[0] for line in self.make(*arguments, status=status).splitlines()]
        return [name for name in names if name in CHAIN]


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


def test_what_a_stage_wrote_is_told_once(project: Project) -> None:
    project.configure(simulate={"max_iterations": 100})
    assert project.make(LAST).count(str(project.run / WRITES[LAST])) == 1


def test_only_what_is_stale_runs(project: Project) -> None:
    before = {name: (project.run / name).read_bytes() for name in WRITES.values()}
    project.configure(train=TINY["train"] | {"learning_rate": 1e-3})
    assert project.stages("-n", LAST) == ["train", "cubature", "simulate"]
    assert {name: (project.run / name).read_bytes() for name in WRITES.values()} == before
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
    project.configure(train=TINY["train"] | {"r": None, "tolerance_mm": 1e-9})  # no r holds that
    assert project.stages(LAST, status=2) == ["train"]
    assert {name: (project.run / name).read_bytes() for name in WRITES.values()} == before
    assert project.stages("-n", LAST) == ["train", "cubature", "simulate"]


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
    others = "demo paper examples pictures test lint bounds settings site clean help"
    assert listed == {*CHAIN, *others.split()}


def test_the_tests_do_not_see_the_environment_of_who_runs_them() -> None:
    """As in a make that was started by another one, on an experiment of its own, in a narrow window."""
    callers = {"MAKEFLAGS": "w -- RUNS=elsewhere", "MAKELEVEL": "2", "LDSIM_DATA": "nowhere", "COLUMNS": "20"}
    test = f"{Path(__file__).relative_to(ROOT)}::{test_help_lists_every_goal.__name__}"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | callers, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("name", ["", " "])
def test_cleaning_without_a_name_removes_nothing_and_asks_for_one(name: str, tmp_path: Path) -> None:
    project = Project(tmp_path)
    (project.run / "report").mkdir(parents=True)
    (tmp_path / "runs" / "other").mkdir()
    assert "EXPERIMENT is empty" in project.refusal("clean", f"EXPERIMENT={name}")
    assert "RUNS is empty" in project.refusal("clean", f"RUNS={name}")
    assert project.run.exists()
    project.make("clean")
    assert not project.run.exists() and (tmp_path / "runs" / "other").exists()
