"""The reduced step as a library in C that runs a model anywhere: its sources, its model file, and a way to call it.

`ldsim.c` and `ldsim.h` are the library (docs/guide/runtime.md), `ldsim.wasm` is what tools/wasm.py makes of them;
`model_file` writes what it loads, `library` builds it with this machine's C compiler and calls it from Python.
"""

from __future__ import annotations

from importlib.resources import files


def source(name: str) -> str:
    """The text of a file of the library: ldsim.c, ldsim.h, example.c, example.mjs or Makefile."""
    return files("ldsim.runtime").joinpath(name).read_text(encoding="utf-8")


def webassembly() -> bytes:
    """The library for pages."""
    return files("ldsim.runtime").joinpath("ldsim.wasm").read_bytes()
