"""The JavaScript of the pages, which lies in evaluation/web and goes into them whole."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files

# What draws a moving surface, in the order in which later files use earlier ones.
DRAWING = ("surface.js", "view.js")


def script(names: Sequence[str]) -> str:
    """The given files of evaluation/web, one after another; they share one scope."""
    return "\n".join(files("ldsim.report").joinpath("web", name).read_text(encoding="utf-8") for name in names)


def scoped(names: Sequence[str]) -> str:
    """The same as a program of its own, whose names no other script of the page sees."""
    return f'(() => {{\n"use strict";\n{script(names)}\n}})();\n'
