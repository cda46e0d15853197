"""What the pages are made of: HTML and styles in pages/, and the JavaScript of src/ as build.sh has bundled it."""

from __future__ import annotations

import json
from importlib.resources import files

__all__ = ["bundle", "inlined", "page"]


def bundle(name: str) -> str:
    """The script of one kind of page, "report" or "exported": it imports nothing and keeps its names to itself."""
    return _read("bundles", f"{name}.js")


def page(name: str) -> str:
    """The text of a file of pages/."""
    return _read("pages", name)


def inlined(value: object) -> str:
    """JSON that may stand inside a script element.

    Raises:
        ValueError: if a number is not finite, which JSON cannot say.
    """
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _read(folder: str, name: str) -> str:
    return files("ldsim.web").joinpath(folder, name).read_text(encoding="utf-8")
