"""Measured numbers of a reader's pages come from files, and say so where they are stale."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from reproduction.pages import PAGES, ROOT, code, filled, input_hashes, stale_numbers, staleness, unmarked

MEASURED = re.compile(r"\d[\d.,]*\s?(?:%|ms\b|µs\b|min\b|times as)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_numbers_of_a_page_are_those_of_the_files(page: Path) -> None:
    text = page.read_text("utf-8")
    assert filled(text) == text, "run `python docs/generate.py` and commit what it writes"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_of_stale_numbers_has_a_place_that_says_so(page: Path) -> None:
    text = page.read_text("utf-8")
    assert not stale_numbers(text) or "<!-- stale: numbers -->" in text


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_number_does_not_break_its_paragraph(page: Path) -> None:
    """A comment at the beginning of a line ends the paragraph before it, in any Markdown."""
    assert not re.findall(r"^\s*<!-- /?number.*", page.read_text("utf-8"), flags=re.M)


def test_the_readme_has_no_measured_number_that_no_file_holds() -> None:
    text = re.sub(r"^```.*?^```", "", unmarked((ROOT / "README.md").read_text("utf-8")), flags=re.M | re.S)
    assert not MEASURED.findall(text)


def test_the_first_screen_can_be_read_aloud_in_a_minute() -> None:
    text = unmarked((ROOT / "README.md").read_text("utf-8")).partition("\n## Start")[0]
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)  # code is not read aloud
    spoken = re.sub(r"!\[[^\]]*\]\([^)]*\)|\]\([^)]*\)", "", text)
    assert 100 < len(re.findall(r"\w+", spoken)) <= 170  # and three numbers


def result(folder: Path, **changes: object) -> Path:
    row = {"model": "demo", "unit": "", "goal": None}
    values = {"median step, linear, a": 0.5, "online error, linear, a": 0.125, "median step, latent, a": 0.25}
    content = {
        "machine": {"cpu": "a processor", "cores": 2},
        "command": "make",
        "created": "2030-01-02T00:00:00",
        "rows": [row | {"quantity": q, "value": v} for q, v in (values | {"online error, latent, a": None}).items()],
    }
    (folder / "some.json").write_text(json.dumps(content | changes))
    return folder


def test_a_number_and_a_table_are_written_anew_and_nothing_else_is_touched(tmp_path: Path) -> None:
    number = "<!-- number: some.json | demo | online error, linear, a | {:.1%} -->"
    text = f"before {number}old<!-- /number --> between <!-- table: some.json | motions --><!-- /table --> after"
    found = filled(text, result(tmp_path))
    assert found.startswith(f"before {number}12.5%<!-- /number --> between <!-- table: some.json | motions -->")
    assert "| demo | a | 0.5 ms | 12.5 % | 0.25 ms | lost |" in found and found.endswith("<!-- /table --> after")
    assert filled(found, tmp_path) == found
    assert unmarked(found) == "before  between  after"


def test_a_quantity_that_no_row_has_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(KeyError):
        filled("<!-- number: some.json | demo | nothing | {} --><!-- /number -->", result(tmp_path))


def test_a_result_is_stale_when_what_it_was_made_from_has_changed() -> None:
    inputs = input_hashes(["ldsim/space", "configs/demo.yaml"])
    assert not staleness({"inputs": inputs})
    assert staleness({"inputs": inputs | {"configs/demo.yaml": "0" * 64}})
    assert staleness({"inputs": {}}) and staleness({})
    assert staleness({"inputs": inputs, "earlier": {"x": {"inputs": inputs | {"configs/demo.yaml": "0" * 64}}}})
    assert not staleness({"inputs": inputs, "earlier": {"x": {"inputs": inputs}}})


def test_a_comment_or_a_docstring_makes_no_result_stale_and_code_does() -> None:
    source = (
        '"""A room."""\nONE = "# 1"  # the first\n\n\nclass Thing:\n    """Two\n    lines."""\n\n    x = f"{ONE}"\n'
    )
    assert code(source) == 'ONE = "# 1"\nclass Thing:\n    x = f"{ONE}"'
    assert code(source.replace("the first", "one").replace("lines", "words")) == code(source)
    assert code(source.replace("# 1", "# 2")) != code(source)


def test_a_stale_table_says_so(tmp_path: Path) -> None:
    text = "<!-- table: some.json | motions --><!-- /table -->"
    assert "**Stale**" in filled(text, result(tmp_path))
    assert "**Stale**" not in filled(text, result(tmp_path, inputs=input_hashes(["LICENSE"])))


def test_a_page_says_of_which_days_its_stale_numbers_are(tmp_path: Path) -> None:
    number = "<!-- number: {}.json | demo | online error, linear, a | {{:.1%}} -->12.5%<!-- /number -->"
    text = f"{number.format('some')}{number.format('other')}<!-- stale: numbers -->old<!-- /stale -->"
    known = json.loads((result(tmp_path, inputs=input_hashes(["LICENSE"])) / "some.json").read_text(encoding="utf-8"))

    def told(some: dict[str, object], other: dict[str, object]) -> str:
        for name, content in {"some": some, "other": other}.items():
            (tmp_path / f"{name}.json").write_text(json.dumps(known | content), encoding="utf-8")
        return stale_numbers(text, tmp_path)

    changed, earlier = {"inputs": {"LICENSE": "0" * 64}}, {"created": "2029-12-31T00:00:00+00:00"}
    assert not told({}, earlier)
    assert told(changed, earlier).endswith("measured (2030-01-02).")
    assert told(changed, earlier | {"inputs": {}}).endswith("measured (2029-12-31 to 2030-01-02).")
    # where a model has an origin of its own, that one counts
    assert not told(changed | {"earlier": {"demo": known}}, {})
    assert told({"earlier": {"demo": known | changed | earlier}}, {}).endswith("measured (2029-12-31).")
