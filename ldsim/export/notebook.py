"""A finished run in a cell of a notebook: the page that simulates by itself."""

from __future__ import annotations

import html
from pathlib import Path

from ldsim.export.playground import playground_page
from ldsim.run import Run


class NotebookView:
    """What a notebook shows; `str` of it is the page."""

    def __init__(self, page: str, height: int) -> None:
        self._page, self._height = page, height

    def __str__(self) -> str:
        return self._page

    def _repr_html_(self) -> str:
        page = html.escape(self._page, quote=True)
        return f'<iframe srcdoc="{page}" style="width: 100%; height: {self._height}px; border: 0"></iframe>'


def view(run: str | Path, height: int = 480) -> NotebookView:
    """A run to be pulled in a cell of a notebook, `height` pixels high; it needs no server and no network.

    Raises:
        ValueError: the height is no positive whole number.
        ArtefactError: an artefact is missing, damaged, or was made from other files than those beside it.
    """
    if not isinstance(height, int) or height < 1:  # a browser says nothing of one that it cannot read
        raise ValueError(f"height is {height!r}; it must be a whole number of pixels, at least 1")
    with Run.open(run) as opened:
        return NotebookView(playground_page(opened), height)
