"""Zig compiles the library for every platform; what it makes bears the mark of that platform, and this one's runs."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from ldsim.errors import SolverError
from ldsim.export import fmu
from ldsim.runtime import compilers
from ldsim.runtime.compilers import HERE, PLATFORMS, _here, shared_library
from ldsim.runtime.library import Library, NativeModel, NativeSolid, build
from ldsim.runtime.model_file import model_bytes
from tests.runtime.problems import latent

SOURCES = ("ldsim.c", "ldsim.h")
# Where the machine stands in a file of that kind, and what stands there: ELF, Mach-O, and MZ of Windows.
MARKS = {
    "linux-x86_64": (b"\x7fELF", 18, b"\x3e\x00"),
    "linux-arm64": (b"\x7fELF", 18, b"\xb7\x00"),
    "macos-arm64": (b"\xcf\xfa\xed\xfe", 4, b"\x0c\x00\x00\x01"),
    "windows-x86_64": (b"MZ", 0, b"MZ"),
}
needs_zig = pytest.mark.skipif(
    importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed: pip install 'ldsim[wasm]'"
)


@needs_zig
@pytest.mark.parametrize("platform", PLATFORMS)
def test_the_library_is_compiled_for_a_platform(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, platform: str) -> None:
    monkeypatch.setattr(compilers, "compiler", lambda: None)
    made = shared_library(tmp_path, SOURCES, "libldsim", platform)
    data, (magic, at, machine) = made.read_bytes(), MARKS[platform]
    assert data.startswith(magic) and data[at : at + len(machine)] == machine
    assert all(f"ldsim_{name}".encode() in data for name in ("load", "step", "restore"))
    assert len(data) <= 300_000
    if platform != HERE:
        return
    space = latent()
    (tmp_path / "own").mkdir()
    monkeypatch.undo()
    solids = [
        NativeSolid(NativeModel(Library(library), model_bytes(space))) for library in (made, build(tmp_path / "own"))
    ]
    for _ in range(20):
        for solid in solids:
            solid.step()
    u, v = (solid.displacements() for solid in solids)
    assert 0 < np.abs(u).max() and np.abs(u - v).max() <= 1e-6 * np.abs(u).max()


@pytest.mark.parametrize(
    ("system", "processor", "name"),
    [
        ("Windows", "AMD64", "windows-x86_64"),
        ("Linux", "aarch64", "linux-arm64"),
        ("Darwin", "arm64", "macos-arm64"),
        ("Linux", "riscv64", "linux-riscv64"),
        ("FreeBSD", "amd64", "FreeBSD-x86_64"),
    ],
)
def test_a_machine_is_called_by_its_own_name(system: str, processor: str, name: str) -> None:
    assert _here(system, processor) == name


def test_a_machine_that_zig_is_not_asked_for_needs_a_compiler_of_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(compilers, "compiler", lambda: None)
    monkeypatch.setattr(compilers, "HERE", "linux-riscv64")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: "found")
    with pytest.raises(
        SolverError, match="no C compiler was found for linux-riscv64, and zig is asked only for linux-"
    ):
        shared_library(tmp_path, SOURCES, "libldsim")


def test_a_unit_is_refused_where_its_platform_has_no_name_in_fmi(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(fmu, "HERE", "linux-riscv64")
    with pytest.raises(SolverError, match="unknown platform 'linux-riscv64'; known are linux-x86_64"):
        fmu.write_fmu(latent(), tmp_path)


def test_without_a_compiler_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compilers, "compiler", lambda: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SolverError, match=r"no C compiler for linux-arm64 was found; run pip install 'ldsim\[wasm\]'"):
        shared_library(tmp_path, SOURCES, "libldsim", "linux-arm64")
    with pytest.raises(SolverError, match="unknown platform 'amiga'; known are linux-x86_64"):
        shared_library(tmp_path, SOURCES, "libldsim", "amiga")
