"""docs/paper.md: what was found stands beside the paper's numbers, and nothing that was not made."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from reproduction.paper.page import paper_page, title
from reproduction.paper.table import EXPERIMENTS


def content(*relations: dict[str, Any], **numbers: Any) -> dict[str, Any]:
    return {
        "relations": list(relations),
        "numbers": numbers,
        "machine": {"cpu": "some processor", "cores": 2},
        "command": "make paper",
        "created": "2026-11-25T00:00:00",
        "commit": "abc",
    }


def relation(value: float | None, holds: bool, paper: float | None = None) -> dict[str, Any]:
    return {"claim": "one over another", "value": value, "goal": "< 1", "holds": holds, "paper": paper}


def page_of(folder: Path, **contents: Any) -> str:
    for name, found in contents.items():
        (folder / f"{name}.json").write_text(json.dumps(found), encoding="utf-8")
    return paper_page(folder)


@pytest.mark.parametrize(("name", "words"), [("table1", "Table 1"), ("fig10", "Figure 10"), ("solvers", "Solvers")])
def test_an_experiment_is_called_as_the_paper_calls_it(name: str, words: str) -> None:
    assert title(name) == words


def test_a_relation_stands_beside_the_papers_number_with_its_verdict(tmp_path: Path) -> None:
    page = page_of(tmp_path, fig9=content(relation(1.5, False, 0.511), relation(0.25, True), relation(None, False)))
    assert "| one over another | 0.511 | 1.5 | < 1 | **fails** |" in page
    assert "| one over another | – | 0.25 | < 1 | holds |" in page
    assert "| one over another | – | – | < 1 | **fails** |" in page
    assert "| [Figure 9](#figure-9) |" in page
    assert "| 1 of 3 |" in page
    assert EXPERIMENTS["fig9"].paper in page


def test_table_one_has_a_line_of_ours_and_one_of_the_papers_for_each_model(tmp_path: Path) -> None:
    side = {"dimension": 20, "points": 359, "step_ms": 3.0, "online_error": 0.05}
    row = {"cells": 29686, "k": 19, "train_s": 60.0, "pca_s": 30.0, "cubature_s": 100.0}
    lost = side | {"dimension": 6, "step_ms": 2.0, "online_error": None}
    page = page_of(tmp_path, table1=content(rows={"x": row | {"linear": side, "latent": lost}}))
    assert "| x, here | 29,686 | 60 | 30 | 100 | 359 | 20 | 6 (19) | 3 | 2 | 1.5 |" in page
    assert "| x, paper | 29,686 | 290 | 34 | 9,083 | 359 | 13 | 6 (19) | 5.2 | 4.6 | 1.13 |" in page
    assert "| x | 5 % | lost |" in page


def test_what_was_not_made_is_named(tmp_path: Path) -> None:
    page = page_of(tmp_path, fig9=content())
    assert "Not made yet: Table 1, Figure 2" in page
    assert "Figure 9," not in page
