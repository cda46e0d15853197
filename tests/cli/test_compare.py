"""`ldsim compare`: the two files it writes, where they link to, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import Result

from tests.cli.experiments import invoked, refused
from tests.report.example_report import example_report
from tests.report.test_page import Outline


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """A folder of two finished runs, of which only the reports are there."""
    for name in ("x", "my part"):
        folder = tmp_path / "runs" / name / "report"
        folder.mkdir(parents=True)
        (folder / "report.json").write_text(json.dumps(example_report() | {"experiment": name}), encoding="utf-8")
        (folder / "report.html").touch()
    return tmp_path / "runs"


def compare(*arguments: object) -> Result:
    return invoked("compare", *map(str, arguments))


def test_a_page_and_its_numbers_are_written_and_the_page_s_path_is_the_last_line(runs, tmp_path):
    output = tmp_path / "pages" / "both.html"
    result = compare(runs / "x", runs / "my part", "-o", output)
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[-1] == str(output.resolve())
    numbers = json.loads(output.with_suffix(".json").read_text())
    assert [run["experiment"] for run in numbers["runs"]] == ["x", "my part"]
    links = set(Outline(output.read_text()).values("a", "href"))
    assert links == {"../runs/x/report/report.html", "../runs/my%20part/report/report.html"}


def test_left_out_the_output_is_in_the_working_folder(runs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert compare("runs/x").exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"runs", "compare.html", "compare.json"}


def test_what_it_cannot_use_is_one_line_and_nothing_is_written(runs, tmp_path):
    page = tmp_path / "a.html"
    (tmp_path / "folder.html").mkdir()
    for arguments, words in (
        ([runs / "x", runs, "-o", page], "runs/report/report.json does not exist; run `ldsim report CONFIG`"),
        ([runs / "y", "-o", page], "does not exist or is no folder"),
        ([runs / "x", runs / "x", "-o", page], "is given 2 times"),
        ([runs / "x", "-o", tmp_path / "a.pdf"], "a.pdf; expected the name of a file that ends in .html"),
        ([runs / "x", "-o", tmp_path / "folder.html"], "folder.html; expected the name of a file"),
        ([runs / "x", "-o", runs / "x" / "report" / "report.json" / "a.html"], "cannot write"),
    ):
        assert words in refused(compare(*arguments))
    assert {path.name for path in tmp_path.iterdir()} == {"runs", "folder.html"}


def test_without_a_run_the_usage_is_shown():
    result = compare()
    assert result.exit_code == 2 and "Missing argument 'RUN...'" in result.output
