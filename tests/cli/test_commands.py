"""What every command has in common when all goes well."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import h5py
import pytest
import yaml

from ldsim import __version__
from ldsim.artefacts.sealed_file import datasets
from ldsim.cli.app import COMMANDS as KNOWN
from ldsim.run import Run
from ldsim.settings import STAGES, load_settings, settings_of
from tests.cli.experiments import COMMANDS, READS, TINY, WRITES, Experiment, invoked, refused

ALL = ["new", "make", *COMMANDS, "list", "open", "info", "settings"]


def test_all_commands_are_listed_in_the_order_they_run() -> None:
    others = ["list", "open", "compare", "play", "record", "export", "info", "settings"]
    assert list(KNOWN) == ["new", "make", *STAGES, *others]
    text = invoked("-h").stdout
    places = [text.index(f"  {name} ") for name in KNOWN]
    assert places == sorted(places)


@pytest.mark.parametrize("command", ALL)
@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_every_command_explains_itself(command: str, flag: str) -> None:
    result = invoked(command, flag)
    assert result.exit_code == 0
    assert result.stdout.startswith("Usage: ")
    assert f" {command} " in result.stdout.splitlines()[0]


@pytest.mark.parametrize("arguments", [["--version"], *([command, "--version"] for command in ALL)], ids=" ".join)
def test_every_command_tells_the_version(arguments: list[str]) -> None:
    result = invoked(*arguments)
    assert result.exit_code == 0
    assert result.stdout == f"ldsim, version {__version__}\n"


@pytest.mark.parametrize("arguments", [["no-such-command"], ["mesh"], ["mesh", "a", "b"], ["info"]], ids=" ".join)
def test_a_wrong_call_shows_the_usage(arguments: list[str]) -> None:
    result = invoked(*arguments)
    assert result.exit_code == 2
    assert result.stderr.startswith("Usage: ")


@pytest.mark.parametrize("command", ["mesh", "make", "settings"])
def test_a_mesh_in_place_of_a_configuration_is_told_what_to_do(command: str) -> None:
    result = invoked(command, "solids/part.STL")
    assert result.exit_code == 1
    assert "is a mesh or surface file, not a configuration; `ldsim new solids/part.STL` looks at it" in result.stderr
    assert "writes part.yaml, which `ldsim make` takes" in result.stderr


@pytest.mark.parametrize("command", [command for command in COMMANDS if command in WRITES])
def test_info_tells_the_kind_and_what_an_artefact_was_made_from(experiment: Experiment, command: str) -> None:
    path = experiment.run / WRITES[command]
    result = invoked("info", str(path))
    assert result.exit_code == 0
    first, *rest = result.stdout.splitlines()
    assert first.startswith(f"{path}: {path.stem}, written by ldsim {__version__} on ")
    assert "  experiment: tiny" in rest
    made_from = {line.split()[2].rstrip(":") for line in rest if line.startswith("  made from ")}
    assert made_from <= {name.removesuffix(".h5") for name in READS[command]} | {"tests"}
    assert "datasets:" in rest


@pytest.mark.parametrize("command", [command for command in COMMANDS if command in WRITES])
def test_a_stage_repeats_itself(experiment: Experiment, command: str) -> None:
    """All but times and the date: run again on the same input, a stage writes the same numbers."""

    def content(path: Path) -> dict[str, bytes]:
        with h5py.File(path, "r") as file:
            return {name: data[()].tobytes() for name, data in datasets(file).items() if "seconds" not in name}

    path = experiment.run / WRITES[command]
    before = content(path)
    assert experiment.invoke(command).exit_code == 0
    after = content(path)
    if command == "simulate":  # which minimiser is the fastest may differ from run to run, and with it the last digits
        assert before.keys() == after.keys()
    else:
        assert before == after


def test_settings_prints_the_configuration_with_defaults(experiment: Experiment) -> None:
    result = invoked("settings", str(experiment.config))
    assert result.exit_code == 0
    printed = yaml.safe_load(result.stdout)
    assert printed["mesh"]["density"] == 1000.0
    assert set(printed) == {"experiment", *STAGES}
    assert "# its slowest frequencies are " in result.stdout and "# pulls of 80 mm by a spring" in result.stdout
    told = next(line for line in result.stdout.splitlines() if line.startswith("# what is left out"))
    assert told.endswith(" unknowns: train.activation elu")


def test_what_follows_from_a_solid_is_told_by_mesh_and_settings_as_training_takes_it(tmp_path: Path) -> None:
    config = tmp_path / "tiny.yaml"
    config.write_text(yaml.safe_dump({name: TINY[name] for name in ("experiment", "mesh", "snapshot")}), "utf-8")
    words = [str(config), "--runs", str(tmp_path)]
    told = [invoked(command, *words).stdout.splitlines()[-1] for command in ("mesh", "settings")]
    with Run(tmp_path / "tiny") as run:
        vertices, unknowns = run.scene.mesh.n_vertices, 3 * len(run.scene.free)
    train = load_settings(config).train.of_solid(vertices, unknowns)
    line = (
        f"what is left out follows from its {vertices} vertices and {unknowns} unknowns: pca.k 40, "
        f"train.hidden [48, 48, 48, 48], train.activation tanh, train.condensed.poses {train.condensed.poses}, "
        f"train.condensed.explored {train.condensed.explored}"
    )
    assert told == [line, f"# {line}"]


def test_the_configuration_that_a_report_shows_makes_the_run_again(experiment: Experiment) -> None:
    report = json.loads((experiment.run / "report" / "report.json").read_text(encoding="utf-8"))
    again = settings_of(yaml.safe_load(report["made_from"]["configuration"]), "of the report")
    given = load_settings(experiment.config)
    assert again.experiment == given.experiment
    assert again.snapshot.learned == given.snapshot.learned and again.snapshot.tests == given.snapshot.tests
    for stage in ("mesh", "pca", "train", "cubature", "simulate"):
        assert again.section(stage) == given.section(stage), stage


WITHOUT_TORCH = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "torch":
            raise ModuleNotFoundError("No module named 'torch'", name="torch")
sys.meta_path.insert(0, Missing())
from ldsim.cli.app import main
main(sys.argv[1:])
"""


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (
            ["train", "none.yaml"],
            1,
            "error: this command needs PyTorch, which is missing; run pip install 'ldsim[train]'",
        ),
        (["play", "none", "--no-browser"], 1, "error: none"),
        (["export", "none", "--playground"], 1, "error: none"),
        (["report", "none.yaml"], 1, "error: configuration none.yaml does not exist"),
    ],
    ids=["train", "play", "export", "report"],
)
def test_without_torch_all_but_training_works_as_ever(arguments: list[str], status: int, said: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_TORCH, *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == status and said in done.stderr, done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("command", [each for each in KNOWN if each != "list"])
def test_a_name_that_is_too_long_is_refused(command: str) -> None:
    given = [f"{'a' * 300}.stl" if command in ("new", "record") else "a" * 300]
    given += {"compare": given, "export": ["--playground"]}.get(command, [])
    assert "too long" in refused(invoked(command, *given))
