"""What the pages are made of: HTML, styles and the palette in pages/, the JavaScript of src/ as bundled by build.sh."""

from __future__ import annotations

import json
import re
from importlib.resources import files

__all__ = ["bundle", "inlined", "page", "playground", "playground_style", "script"]


def bundle(name: str) -> str:
    """The script of one kind of page, "report" or "playground": it imports nothing and keeps its names to itself."""
    return files("ldsim.web").joinpath("bundles", f"{name}.js").read_text(encoding="utf-8")


def script(name: str) -> str:
    """A module of src/ that stands on its own."""
    return files("ldsim.web").joinpath("src", name).read_text(encoding="utf-8")


def page(name: str) -> str:
    """The text of a file of pages/."""
    return files("ldsim.web").joinpath("pages", name).read_text(encoding="utf-8")


def inlined(value: object) -> str:
    """JSON that may stand inside a script element.

    Raises:
        ValueError: if a number is not finite, which JSON cannot say.
    """
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def playground(style: str, script: str) -> str:
    """The playground's HTML around the elements that hold or name its style and its script."""
    # One pass: what is put in may hold braces of its own.
    parts = {"style": style, "script": script}
    return re.sub(r"\{(\w+)\}", lambda found: parts[found[1]], page("playground.html"))


def playground_style() -> str:
    """The playground's style, with the palette."""
    return page("palette.css") + page("playground.css")
