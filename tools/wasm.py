"""Compiles the C library to WebAssembly: `python -m tools.wasm` writes ldsim/runtime/ldsim.wasm, which is committed.

Needs the package ziglang, a C compiler for every platform, which only who changes the library has to install (the extra
`wasm`). The file ends with a custom section that holds the SHA-256 of the sources and flags; a test compares.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from ldsim.runtime import source

TARGET = Path(__file__).parent.parent / "ldsim" / "runtime" / "ldsim.wasm"
FLAGS = ("-target", "wasm32-wasi", "-mexec-model=reactor", "-std=c99", "-O3", "-msimd128", "-DLDSIM_NO_FILES", "-s")
SECTION = b"ldsim-sources"


def exported() -> list[str]:
    """Every function that the header declares, but for those of files, and what a host needs to hand over numbers."""
    declared = re.findall(r"\b(ldsim_\w+)\(", re.sub(r"/\*.*?\*/", "", source("ldsim.h"), flags=re.DOTALL))
    return [*(name for name in declared if name != "ldsim_load_file"), "malloc", "free"]


def stamp() -> bytes:
    """The custom section: a module that ends with it was made of the sources as they are."""
    text = "".join([source("ldsim.h"), source("ldsim.c"), *FLAGS])
    digest = hashlib.sha256(text.encode()).hexdigest().encode()
    content = bytes([len(SECTION)]) + SECTION + digest
    return bytes([0, len(content)]) + content


def compiled() -> bytes:
    """The module, without its stamp."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("ldsim.c", "ldsim.h"):
            Path(folder, name).write_text(source(name), encoding="utf-8")
        exports = [f"-Wl,--export={name}" for name in exported()]
        command = [sys.executable, "-m", "ziglang", "cc", *FLAGS, *exports, "ldsim.c", "-o", "ldsim.wasm"]
        subprocess.run(command, cwd=folder, check=True)
        return Path(folder, "ldsim.wasm").read_bytes()


if __name__ == "__main__":
    TARGET.write_bytes(compiled() + stamp())
