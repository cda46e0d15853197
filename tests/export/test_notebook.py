"""A run in a notebook's cell: the page that simulates by itself, whole, in a frame."""

from __future__ import annotations

import html
from pathlib import Path

import ldsim
from ldsim.export.playground import playground_page
from ldsim.run import Run
from tests.simulator.playable import write_playable


def test_a_cell_holds_the_page_in_a_frame(tmp_path: Path) -> None:
    write_playable(tmp_path, resolution=1)
    shown = ldsim.view(tmp_path, height=300)
    with Run.open(tmp_path) as run:
        assert str(shown) == playground_page(run)
    cell = shown._repr_html_()
    assert cell.startswith('<iframe srcdoc="') and "height: 300px" in cell
    assert html.unescape(cell.split('srcdoc="')[1].split('"')[0]) == str(shown)
