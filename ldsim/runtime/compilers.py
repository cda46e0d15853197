"""Which compiler makes a library of the C sources: this machine's own, or zig, which makes one for every platform."""

from __future__ import annotations

import importlib.util
import platform as machine
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ldsim.errors import SolverError
from ldsim.runtime import source

# Contraction and no traps let loops run in vectors; neither hides an infinite energy, as -ffast-math would.
OPTIMISED = ("-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")


class Platform(NamedTuple):
    """What zig calls it, the ending of its shared libraries, and its folder in an FMU of FMI 3."""

    target: tuple[str, ...]
    suffix: str
    fmi3: str


PLATFORMS = {
    "linux-x86_64": Platform(("x86_64-linux-gnu.2.17", "-mcpu=x86_64_v3"), ".so", "x86_64-linux"),
    "linux-arm64": Platform(("aarch64-linux-gnu.2.17",), ".so", "aarch64-linux"),
    "macos-arm64": Platform(("aarch64-macos",), ".dylib", "aarch64-darwin"),
    "windows-x86_64": Platform(("x86_64-windows-gnu", "-mcpu=x86_64_v3"), ".dll", "x86_64-windows"),
}
SYSTEMS = {"Linux": "linux", "Darwin": "macos", "Windows": "windows"}
PROCESSORS = {"aarch64": "arm64", "amd64": "x86_64"}


def _here(system: str, processor: str) -> str:
    """This machine as `PLATFORMS` calls it, or by its own names where it is none of them."""
    processor = processor.lower()
    return f"{SYSTEMS.get(system, system)}-{PROCESSORS.get(processor, processor)}"


HERE = _here(machine.system(), machine.machine())


def compiler() -> str | None:
    """The C compiler of this machine, None where there is none."""
    return next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)


def shared_library(
    folder: Path, sources: Sequence[str], name: str, platform: str | None = None, flags: Sequence[str] = ()
) -> Path:
    """Compile sources of the package into a shared library in a folder; returns it.

    Args:
        platform: one of `PLATFORMS`, compiled by zig; left out, this machine, by its own compiler where there is one.

    Raises:
        SolverError: the platform is not known, there is no compiler, or it fails.
    """
    if platform is not None and platform not in PLATFORMS:
        raise SolverError(f"unknown platform {platform!r}; known are {', '.join(PLATFORMS)}")
    for file in sources:
        (folder / file).write_text(source(file), encoding="utf-8")
    suffix = PLATFORMS[platform or HERE].suffix if (platform or HERE) in PLATFORMS else ".so"
    made = folder / f"{name}{suffix}"
    command = [*_command(platform), "-std=c99", *OPTIMISED, *flags, "-shared", "-fPIC"]
    command += [file for file in sources if file.endswith(".c")]
    done = subprocess.run([*command, "-o", made.name, "-lm"], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise SolverError(f"{' '.join(command)} failed: {done.stderr.strip()}")
    return made


def _command(platform: str | None) -> list[str]:
    own = compiler()
    if own is not None and platform in (None, HERE):
        return [own]
    if importlib.util.find_spec("ziglang") is None:
        for_what = f" for {platform}" if platform is not None else ""
        raise SolverError(f"no C compiler{for_what} was found; run pip install 'ldsim[wasm]', which brings zig")
    if (platform or HERE) not in PLATFORMS:
        raise SolverError(
            f"no C compiler was found for {HERE}, and zig is asked only for {', '.join(PLATFORMS)}; "
            "install cc, gcc or clang"
        )
    target = PLATFORMS[platform or HERE].target
    return [sys.executable, "-m", "ziglang", "cc", "-target", *target, "-s"]
