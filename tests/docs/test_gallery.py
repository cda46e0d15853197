"""Every example that ships has run as it is now, or it is said why not, and the gallery says what came of it."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from reproduction.bench import examples
from reproduction.harness import CONFIGS, row
from reproduction.pages import input_hashes

ROOT = Path(__file__).parents[2]
SHIPPED = sorted(CONFIGS.glob("*.yaml"))
RESULT: Any = json.loads(examples.RESULT.read_text("utf-8"))


def rows_of(name: str, content: Any = RESULT) -> dict[str, Any]:
    return {each["quantity"]: each["value"] for each in content["rows"] if each["model"] == name}


@pytest.mark.parametrize("config", SHIPPED, ids=lambda config: config.stem)
def test_an_example_has_run_as_it_is_now_or_the_reason_is_known(config: Path) -> None:
    again = f"run `python -m reproduction.bench.examples {config.stem}` and commit what it writes"
    found, files = rows_of(config.stem), input_hashes(examples.files_of(config))
    assert found, f"{config.stem} has never run: {again}"
    assert files.items() <= RESULT["inputs"].items(), f"{config.stem} has changed since it ran: {again}"
    if examples.LEFT_OUT in found:
        assert "LDSIM_DATA" in found[examples.LEFT_OUT] and "LDSIM_DATA" in config.read_text("utf-8")
        return
    failed = [each for each in RESULT["rows"] if each["model"] == config.stem and examples.missed(each)]
    assert not failed and found["live page"] > 0.1, f"{config.stem} failed: {failed}"


def test_an_example_is_left_out_where_what_it_needs_is_not_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LDSIM_DATA", raising=False)
    assert "LDSIM_DATA is not set" in str(examples.lacking(CONFIGS / "beam.yaml"))
    assert examples.lacking(CONFIGS / "ci.yaml") is None
    monkeypatch.setenv("LDSIM_DATA", "/anywhere")
    assert examples.lacking(CONFIGS / "beam.yaml") is None
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert "[surface]" in str(examples.lacking(CONFIGS / "surface.yaml"))


def test_what_is_known_of_an_example_stays_where_it_is_left_out_and_goes_where_it_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(examples, "RESULT", tmp_path / "examples.json")
    config, other = CONFIGS / "beam.yaml", CONFIGS / "pins.yaml"
    for given, rows in (
        (config, [row("beam", "exit status", 0, "", "== 0")]),
        (other, [row("pins", "exit status", 0, "", "== 0")]),
        (config, [row("beam", examples.LEFT_OUT, "LDSIM_DATA is not set")]),
        (other, [row("pins", "exit status", 1, "", "== 0")]),
    ):
        examples.keep(given, rows)
    content = json.loads(examples.RESULT.read_text("utf-8"))
    assert [(each["model"], each["value"]) for each in content["rows"]] == [("beam", 0), ("pins", 1)]
    assert [examples.missed(each) for each in content["rows"]] == [False, True]
    assert content["inputs"] == input_hashes(["configs/beam.yaml", "configs/pins.yaml"])


def test_the_files_of_an_example_are_those_that_it_reads_of_the_project() -> None:
    assert examples.files_of(CONFIGS / "motions.yaml") == [
        "configs/motions.yaml",
        "data/pull.csv",
        "data/two_grabs.yaml",
    ]
    assert examples.files_of(CONFIGS / "beam.yaml") == ["configs/beam.yaml"]


@pytest.mark.skipif(importlib.util.find_spec("mkdocs") is None, reason="mkdocs is missing: pip install 'ldsim[docs]'")
def test_each_example_of_the_gallery_has_its_live_page_or_says_that_it_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from docs import site

    monkeypatch.setattr(site, "LIVE", {"pins": Path("pins.html")})
    text = (ROOT / "docs" / "gallery.md").read_text("utf-8")
    shown = site.on_page_markdown(text, SimpleNamespace(file=SimpleNamespace(src_uri="gallery.md")))
    sections = {part.partition("\n")[0]: part for part in shown.split("\n## ")[1:]}
    assert set(sections) == {config.stem for config in SHIPPED}
    assert "**[Pull at it](live/pins.html)**" in sections.pop("pins")
    assert all("not on this copy of the site" in part and "Pull at it" not in part for part in sections.values())
