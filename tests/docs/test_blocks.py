"""Every block of code on the site is run, or read by what would run it where that takes minutes or another machine.

Python: run by test_examples.py, tests/export/test_fmu.py and here; none is left out. YAML: read
as a configuration by test_docs.py. C: compiled and run here. Lines for a shell: those of `ldsim` that take seconds are
run here, on a small run in place of the demo; those that take minutes or wait for a hand have been run by
`python -m reproduction.bench.blocks`, which says of the few others why nothing can run them, and are read here by the
command line (test_commands.py) and by bash. The examples that `ldsim export` writes are run by tests/runtime.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import shutil
import subprocess
import tomllib
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from ldsim import Run
from ldsim.cli.app import main
from ldsim.export.formats import FORMATS
from ldsim.mechanics.options import MaterialOptions, PullOptions
from ldsim.mechanics.regions import Region, Slab
from ldsim.mesh.options import ShapeOptions
from ldsim.pipeline.mesh import mesh
from ldsim.pipeline.options import MeshOptions, MotionOptions, SnapshotOptions
from ldsim.pipeline.pca import pca
from ldsim.pipeline.snapshot import snapshot
from ldsim.report.options import ReportOptions
from ldsim.report.report import report
from ldsim.runtime.model_file import model_bytes
from ldsim.space.options import PcaOptions
from reproduction.bench.blocks import RESULT
from reproduction.bench.blocks_lines import QUICK, REASONS, is_quick, lines_of, reason
from tests.docs.test_commands import MADE, PAGES, TYPED, parse, typed
from tests.mesh.painted import WRITERS
from tests.report import small_run
from tests.runtime.conftest import cc as cc

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "docs" / "guide"
LIBRARY = ROOT / "ldsim" / "runtime"
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)
# How many blocks of Python each page has, all of them run: whoever adds one adds what runs it.
PYTHON = {
    "README.md": 1,
    "batched.md": 3,
    "export.md": 2,
    "python.md": 6,
    "reduced_space.md": 2,
    "runtime.md": 2,
    "simulator.md": 7,
}
SHELL = re.compile(r"^    (?:\S+=\S* )*(?:\.venv/bin/)?(python -m|pip install|dask) ([^#\n]*)", re.M)


def blocks(page: Path, language: str) -> list[str]:
    return [text for name, text in BLOCK.findall(page.read_text("utf-8")) if name == language]


def test_every_block_is_of_a_language_that_is_run_or_read() -> None:
    found = {page.name: len(blocks(page, "python")) for page in PAGES}
    assert {name: count for name, count in found.items() if count} == PYTHON
    for page in PAGES:
        assert {name for name, _ in BLOCK.findall(page.read_text("utf-8"))} <= {"python", "yaml", "c", "bash", ""}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with the finished runs that the pages speak of, and beside it a surface with a texture."""
    folder = tmp_path_factory.mktemp("blocks") / "here"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(small_run, "FRAMES", {"pulls_1": 14, "pulls_2": 11})
        patch.setattr(small_run, "ROLES", {"pulls_1": "train", "pulls_2": "validation"})
        small_run.write_run(folder / "runs" / "demo")
    with Run.open(folder / "runs" / "demo") as run:
        report(run, ReportOptions(pictures=False))
        x = run.scene.mesh.vertices
    for name in ("part", "toy", "x", "beam"):
        shutil.copytree(folder / "runs" / "demo", folder / "runs" / name)
    scans = folder.parent / "scans"
    scans.mkdir()
    for kind in ("obj", "glb"):
        WRITERS[kind](scans, x.min(axis=0), x.max(axis=0)).rename(scans / f"toy.{kind}")
    yield folder


def lacking(words: list[str]) -> bool:
    """Whether a format of `ldsim export` needs a package that is not there; what it says then has its own test."""
    named = words[words.index("--format") + 1] if "--format" in words else "playground"
    extra = FORMATS[named].extra
    other = "--platform" in words and importlib.util.find_spec("ziglang") is None
    return other or (extra is not None and extra.missing)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_quick_commands_of_a_page_run(page: Path, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: not opened.append(address))
    pattern = re.compile(rf"^    (?:\S+ && )*(?:\S*/)?ldsim ((?:{'|'.join(QUICK)})\b[^#\n]*)", re.M)
    for words in typed(pattern, page):
        if words[0] == "export" and lacking(words):
            continue
        done = CliRunner().invoke(main, words, catch_exceptions=False)
        assert done.exit_code == 0, f"{page.name}: ldsim {' '.join(words)}: {done.output}"
        assert done.output.strip()
        if words[0] in ("export", "compare"):
            assert (place / re.split(r": the | \(|: \d", done.output.strip().splitlines()[-1])[0]).exists(), done.output
    assert all(address.endswith("report.html") for address in opened)


def test_commands_of_other_programs_name_what_is_there() -> None:
    """Modules that are run, extras that are installed; `dask` is Dask's own."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    seen = 0
    for page in [*PAGES, ROOT / "CONTRIBUTING.md"]:
        for program, rest in SHELL.findall(page.read_text("utf-8")):
            seen += 1
            if program == "python -m" and not rest.startswith("pip"):
                assert importlib.util.find_spec(rest.split()[0]) is not None, f"{page.name}: {rest}"
            for name in re.findall(r"\[([\w,]+)\]", rest):
                assert set(name.split(",")) <= set(extras), f"{page.name}: {rest}"
    assert seen >= 5


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_line_for_a_shell_ran_or_there_is_a_reason_why_it_cannot(page: Path) -> None:
    ran = {
        each["quantity"]: each["value"]
        for each in json.loads(RESULT.read_text("utf-8"))["rows"]
        if each["model"] == page.stem
    }
    for line in lines_of(page):
        if not is_quick(line) and reason(line) is None:
            assert ran.get(line) == 0, (
                f"{page.name}: `{line}` "
                + ("has not run" if line not in ran else f"ended with {ran[line]}")
                + f": python -m reproduction.bench.blocks --folder FOLDER {page.stem}"
            )


def test_every_command_that_is_typed_is_among_the_lines_and_every_reason_is_of_one() -> None:
    """What finds the lines to run misses none of those that are found otherwise."""
    lines = [line for page in PAGES for line in lines_of(page)]
    for page in PAGES:
        own = " ".join(lines_of(page))
        for words in [*typed(TYPED, page), *typed(MADE, page)]:
            assert " ".join(words[:2]) in own, f"{page.name}: {words}"
    assert all(any(line.startswith(begins) for line in lines) for begins in REASONS)
    assert sum(map(is_quick, lines)) > 20


def test_what_is_for_bash_or_a_cluster_can_be_read() -> None:
    scripts = [script for page in PAGES for script in blocks(page, "bash")]
    for script in scripts:
        done = subprocess.run(["bash", "-n"], input=script, text=True, capture_output=True)
        assert done.returncode == 0, done.stderr
        for line in re.findall(r"^ldsim (.*)$", script, re.M):
            parse(shlex.split(line))
    (cluster,) = (text for page in PAGES for text in blocks(page, ""))
    assert yaml.safe_load(cluster)["kind"] == "DaskCluster" and len(scripts) == 1


def test_the_lines_of_c_pull_the_solid(place: Path, tmp_path: Path, cc: str) -> None:
    (code,) = blocks(GUIDE / "runtime.md", "c")
    include, _, body = code.partition("\n")
    with Run.open(place / "runs" / "demo") as run:
        (tmp_path / "model.ldsim").write_bytes(model_bytes(run.space("latent")))
        x = run.scene.mesh.vertices
    tip = x[x[:, 0].argmax()]
    point = ", ".join(map(str, tip))
    (tmp_path / "main.c").write_text(
        f"#include <stdio.h>\n#include <stdlib.h>\n{include}\nint main(int count, char **words) {{\n"
        f"double point[3] = {{{point}}}, target[3] = {{{point}}}, force[3], u[{x.size}];\n"
        f"target[1] += atof(words[count - 1]);\n{body}\n"
        f'printf("%g\\n", u[{3 * int(x[:, 0].argmax()) + 1}]);\nreturn 0;\n}}\n'
    )
    command = [cc, "-std=c99", "-Wall", "-Werror", f"-I{LIBRARY}", "main.c", str(LIBRARY / "ldsim.c"), "-lm"]
    subprocess.run([*command, "-o", "main"], cwd=tmp_path, check=True)
    low, high = (
        float(subprocess.run(["./main", up], cwd=tmp_path, capture_output=True, text=True, check=True).stdout)
        for up in ("0", "0.05")
    )
    assert high > low + 1e-3  # it follows the target


def test_training_from_python_and_what_is_read_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    pulls = PullOptions(count=4, reach=0.1, frames=5, rest=5)
    with Run("runs/x") as run:
        mesh(
            run,
            MeshOptions(
                shape=ShapeOptions(name="beam", resolution=1),
                material=MaterialOptions(youngs_modulus=1e5),
                pins=(Region(slab=Slab(axis="x", thickness=0.001)),),
                time_step=0.01,
            ),
        )
        snapshot(run, SnapshotOptions(motions=(MotionOptions(name="pulls", role="train", pulls=pulls),), workers=1))
        basis = pca(run, PcaOptions(k=12)).basis
        q = basis.project(run.snapshots.reader("pulls")(0, 5))
    names: dict[str, Any] = {"q": q}
    for block in blocks(GUIDE / "reduced_space.md", "python"):
        exec(compile(block, "reduced_space.md", "exec"), names)
    assert names["z"].shape == (5, 10) and np.isfinite(names["scores"]).all()


@pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("onnx", "onnxruntime")),
    reason="onnx or onnxruntime is missing: pip install 'ldsim[onnx]' onnxruntime",
)
def test_the_decoder_runs_in_onnx_runtime(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    assert CliRunner().invoke(main, ["export", "runs/demo", "--format", "onnx"]).exit_code == 0
    with Run.open(place / "runs" / "demo") as run:
        decoder = run.model.decoder
    names: dict[str, Any] = {"z": np.full((2, decoder.r), 0.01)}
    exec(compile(blocks(GUIDE / "export.md", "python")[1], "export.md", "exec"), names)
    np.testing.assert_allclose(names["q"], np.stack([decoder(z) for z in names["z"]]), atol=1e-5)
