"""The Python examples of the pages run as they stand, one page after the other block by block."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ldsim import Run, load
from ldsim.export.formats import Choice, export
from ldsim.pipeline.mesh import mesh
from ldsim.settings.experiment import load_settings
from ldsim.simulator import Outcome
from tests.report.small_run import write_run

GUIDE = Path(__file__).parents[2] / "docs" / "guide"


def run_examples(page: str, check: Callable[[dict[str, Any]], None] = lambda _: None) -> dict[str, Any]:
    """Run the blocks of a page, each after those before it, and give back the names that they leave.

    Args:
        check: looks at what the first block left.
    """
    blocks = re.findall(r"^```python\n(.*?)^```", (GUIDE / page).read_text("utf-8"), re.M | re.S)
    assert len(blocks) >= 3
    names: dict[str, Any] = {}
    for i, block in enumerate(blocks):
        exec(compile(block, page, "exec"), names)
        if i == 0:
            check(names)
    return names


def check_the_first_pull(names: dict[str, Any]) -> None:
    """What a newcomer runs first moves the solid, towards the target."""
    pull, tip, unpulled = names["pull"], names["tip"], load("runs/demo")
    unpulled.step(100)
    gained = (pull.centroid - unpulled.centroid(pull.vertices)) @ (pull.target - tip)
    assert gained > 1e-3 * np.linalg.norm(pull.target - tip)  # a millimetre that way, whatever its weight does
    assert np.linalg.norm(names["u"], axis=1).max() > 0.02 * unpulled.scene.mesh.diagonal
    rest = unpulled.scene.mesh.vertices[pull.vertices].mean(axis=0)
    np.testing.assert_allclose(names["start"], rest, atol=1e-12)  # from where what is held has come, not from the tip


def test_the_examples_of_the_simulator_page_run(
    playable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(playable, tmp_path / "runs" / "demo")
    monkeypatch.chdir(tmp_path)
    names = run_examples("simulator.md", check_the_first_pull)
    first, second = names["ends"]  # type: ignore[misc]
    assert abs(first - second).max() > 1e-5  # type: ignore[has-type]


def test_the_pins_of_the_demo_are_lifted_as_the_simulator_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    configs = GUIDE.parents[1] / "configs"
    mesh(Run(tmp_path / "runs" / "demo"), load_settings(configs / "demo.yaml").mesh, base=configs)
    monkeypatch.chdir(tmp_path)
    page = (GUIDE / "simulator.md").read_text("utf-8")
    (block,) = (block for block in re.findall(r"^```python\n(.*?)^```", page, re.M | re.S) if "set_pins" in block)
    names: dict[str, Any] = {"load": load}
    exec(compile(block.rpartition("sim = load")[0], "simulator.md", "exec"), names)
    sim = names["sim"]
    assert sim.counts[Outcome.SOLVED] == sim.last.number
    np.testing.assert_allclose(sim.displacement(names["pinned"]), [[0.0, 0.01, 0.0]] * 50, atol=1e-12)


def test_the_examples_of_the_python_page_run_every_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = run_examples("python.md")
    for kind in ("scene", "snapshots", "basis", "model"):
        assert (tmp_path / "runs" / "small" / f"{kind}.h5").is_file()
    with Run.open(tmp_path / "runs" / "small") as run:
        full = run.played.reader("others")(39, 40)[0]
    np.testing.assert_allclose(names["u"], full, atol=1e-4)  # type: ignore[arg-type]


def test_the_examples_of_the_page_of_batches_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a small solid in place of the demo, which alone has the number."""
    write_run(tmp_path / "runs" / "demo")
    monkeypatch.chdir(tmp_path)
    names = run_examples("batched.md")
    assert tuple(names["u"].shape) == (16, 8, 3)
    assert re.fullmatch(r"recovered \d\.\d{3} of the modulus\n", capsys.readouterr().out)


def test_the_example_of_the_readme_moves_the_solid(
    playable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(playable, tmp_path / "runs" / "demo")
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"^```python\n(.*?)^```", (GUIDE.parents[1] / "README.md").read_text("utf-8"), re.M | re.S)
    names: dict[str, Any] = {}
    exec(compile(block, "README.md", "exec"), names)
    check_the_first_pull(names | {"u": names["sim"].displacement()})


def block_of(page: str, number: int) -> str:
    return re.findall(r"^```python\n(.*?)^```", (GUIDE / page).read_text("utf-8"), re.M | re.S)[number]


def test_the_examples_of_other_pages_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_run(tmp_path / "runs" / "demo")
    monkeypatch.chdir(tmp_path)
    with Run.open("runs/demo") as run:
        export(run, Choice("npz"))
        n = run.scene.mesh.n_vertices
    names: dict[str, Any] = {}
    exec(compile(block_of("export.md", 0), "export.md", "exec"), names)
    assert names["positions"].shape == (n, 3)
    names = {}
    exec(compile(block_of("runtime.md", 0), "runtime.md", "exec"), names)
    assert names["solid"] is not None
