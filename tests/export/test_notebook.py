"""A run in a notebook's cell: the page that simulates by itself, whole, in a frame."""

from __future__ import annotations

import html

import pytest

import ldsim
from ldsim.export.playground import playground_page
from ldsim.run import Run


def test_a_cell_holds_the_page_in_a_frame(run: Run) -> None:
    shown = ldsim.view(run.folder, height=300)
    with Run.open(run.folder) as again:
        assert str(shown) == playground_page(again)
    cell = shown._repr_html_()
    assert cell.startswith('<iframe srcdoc="') and "height: 300px" in cell
    assert html.unescape(cell.split('srcdoc="')[1].split('"')[0]) == str(shown)


@pytest.mark.parametrize("height", ["full", -5, 0, 1.5])
def test_a_height_that_is_none_is_refused(run: Run, height: int) -> None:
    """As of one who takes it for `load`, whose second argument is the space."""
    with pytest.raises(ValueError, match="it must be a whole number of pixels"):
        ldsim.view(run.folder, height)
