"""A reduced model with the library that steps it, in C or as WebAssembly: a folder that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ldsim.runtime import source, webassembly
from ldsim.runtime.compilers import shared_library
from ldsim.runtime.model_file import model_bytes
from ldsim.space.space import Space
from ldsim.web import script

FILES = ("ldsim.c", "ldsim.h", "example.c", "Makefile")


def write_c(space: Space, folder: Path, platforms: Sequence[str] = ()) -> None:
    """Write model.ldsim, the library, an example that pulls the solid, its Makefile, and for each platform the library
    compiled, in a folder of its name.

    Raises:
        ExportError: the library does not know what the space needs.
        SolverError: a platform is not known, or there is no compiler for it.
    """
    _write_model(space, folder)
    for name in FILES:
        (folder / name).write_text(source(name), encoding="utf-8")
    for platform in platforms:
        (folder / platform).mkdir()
        shared_library(folder / platform, ("ldsim.c", "ldsim.h"), "libldsim", platform)
        for name in ("ldsim.c", "ldsim.h"):
            (folder / platform / name).unlink()


def write_wasm(space: Space, folder: Path) -> None:
    """Write model.ldsim, ldsim.wasm, the JavaScript module that calls it, and an example for node and for pages.

    Raises:
        ExportError: the library does not know what the space needs.
    """
    _write_model(space, folder)
    (folder / "ldsim.wasm").write_bytes(webassembly())
    (folder / "solid.mjs").write_text(script("solid.js"), encoding="utf-8")
    (folder / "example.mjs").write_text(source("example.mjs"), encoding="utf-8")


def _write_model(space: Space, folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "model.ldsim").write_bytes(model_bytes(space))
