"""A reduced model with the library in C that steps it: a folder that any C compiler makes a program of."""

from __future__ import annotations

from pathlib import Path

from ldsim.runtime import source
from ldsim.runtime.model_file import model_bytes
from ldsim.space.space import Space

FILES = ("ldsim.c", "ldsim.h", "example.c", "Makefile")


def write_c(space: Space, folder: Path) -> None:
    """Write model.ldsim, the library, an example of thirty lines that pulls the solid, and its Makefile.

    Raises:
        ExportError: the library does not know what the space needs.
    """
    folder.mkdir(exist_ok=True)
    (folder / "model.ldsim").write_bytes(model_bytes(space))
    for name in FILES:
        (folder / name).write_text(source(name), encoding="utf-8")
