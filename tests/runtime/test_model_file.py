"""The model file: what is damaged is refused in words, whatever it is; sanitizers see no fault in what still runs."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.errors import ExportError, SolverError
from ldsim.export.formats import Choice, export
from ldsim.run import Run
from ldsim.runtime import model_file
from ldsim.runtime.library import Library, NativeModel
from ldsim.runtime.model_file import checksum, model_bytes
from tests.report.small_run import write_run
from tests.runtime import fuzz
from tests.runtime.problems import condensed, curved, latent, with_moving_pins

COUNTS, NUMBERS = 40, 160
WORDS = {name: i for i, name in enumerate(("vertices", "triangles", "r", "features", "layers"))}
WORDS |= {"activation": 13, "mapped": 16, "points": 17, "supports": 19, "anchors": 22, "basis_bytes": 24}


def sealed(data: bytearray) -> bytes:
    """With a size and sums that fit."""
    data[16:24] = np.array([len(data)], dtype="<u8").tobytes()
    data[24:40] = checksum(bytes(data[40:]))
    return bytes(data)


def count(name: str, value: int) -> Callable[[bytearray], bytes]:
    """A number in the header."""

    def change(data: bytearray) -> bytes:
        at = COUNTS + 4 * WORDS[name]
        data[at : at + 4] = np.array([value], dtype="<u4").tobytes()
        return sealed(data)

    return change


def put(at: int, value: float) -> Callable[[bytearray], bytes]:
    """A real number somewhere, in places counted from the end where it is negative."""

    def change(data: bytearray) -> bytes:
        start = at if at >= 0 else len(data) + at
        data[start : start + 8] = np.array([value], dtype="<f8").tobytes()
        return sealed(data)

    return change


DAMAGED: dict[str, tuple[Callable[[bytearray], bytes], str]] = {
    "empty": (lambda data: b"", "this is no model of ldsim"),
    "text": (lambda data: b"model: x\n" * 100, "this is no model of ldsim"),
    "line ends changed": (lambda data: bytes(data).replace(b"\r\n", b"\n", 1), "this is no model of ldsim"),
    "version": (lambda data: sealed(data[:8] + b"\1\0\0\0" + data[12:]), "of another version"),
    "header alone": (lambda data: bytes(data[:256]), "has not the size that it says"),
    "cut off": (lambda data: bytes(data[:-8]), "has not the size that it says"),
    "cut off within a word": (lambda data: bytes(data[:-3]), "has not the size that it says"),
    "too long": (lambda data: bytes(data) + b"\0" * 8, "has not the size that it says"),
    "a bit": (lambda data: bytes(data[:-40]) + bytes([data[-40] ^ 4]) + bytes(data[-39:]), "the checksum does not fit"),
    "words exchanged": (
        lambda data: bytes(data[:256] + data[264:272] + data[256:264] + data[272:]),
        "the checksum does not fit",
    ),
    "cut off, with sums that fit": (lambda data: sealed(data[:-8]), "sizes that do not belong together"),
    "no vertices": (count("vertices", 0), "sizes that do not belong together"),
    "vertices beyond the file": (count("vertices", 2**25), "sizes that do not belong together"),
    "layers": (count("layers", 9), "sizes that do not belong together"),
    "more coordinates than features": (count("r", 99), "sizes that do not belong together"),
    "activation": (count("activation", 4), "sizes that do not belong together"),
    "maps beyond the features": (count("mapped", 7), "sizes that do not belong together"),
    "anchors of no compliance": (count("anchors", 1), "sizes that do not belong together"),
    "bytes of the basis": (count("basis_bytes", 2), "sizes that do not belong together"),
    "time step": (put(NUMBERS, 0.0), "a number that must be positive"),
    "time step not finite": (put(NUMBERS, np.nan), "a number that is not finite"),
    "tolerance": (put(NUMBERS + 32, -1.0), "a number that must be positive"),
    "vertex not finite": (put(256 + 8, np.inf), "a number that is not finite"),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_a_damaged_model_is_refused_in_words(library: Library, case: str) -> None:
    change, words = DAMAGED[case]
    data = model_bytes(latent())
    NativeModel(library, data)
    with pytest.raises(SolverError, match=words):
        NativeModel(library, change(bytearray(data)))


@pytest.mark.parametrize("name", ["triangles", "movable", "kind", "near"])
def test_an_index_out_of_range_is_refused(library: Library, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = model_file.pieces

    def spoilt(*given: object) -> model_file.Pieces:
        pieces = made(*given)  # type: ignore[arg-type]
        values = pieces.arrays[name].copy()
        values.flat[values.size // 2] = 2**31
        return pieces._replace(arrays=pieces.arrays | {name: values})

    monkeypatch.setattr(model_file, "pieces", spoilt)
    with pytest.raises(SolverError, match="the model has an index that is out of range"):
        NativeModel(library, model_bytes(condensed()))


@pytest.mark.parametrize("name", ["weights", "mu"])
def test_a_weight_that_is_not_positive_is_refused(library: Library, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = model_file.pieces

    def spoilt(*given: object) -> model_file.Pieces:
        pieces = made(*given)  # type: ignore[arg-type]
        return pieces._replace(arrays=pieces.arrays | {name: -np.asarray(pieces.arrays[name], dtype=np.float64)})

    monkeypatch.setattr(model_file, "pieces", spoilt)
    with pytest.raises(SolverError, match="a number that must be positive"):
        NativeModel(library, model_bytes(latent()))


def test_what_the_library_cannot_step_is_not_written() -> None:
    with pytest.raises(ExportError, match="steps by method bfgs with current: true; got newton"):
        model_bytes(latent(), ReducedOptions(method="newton"))
    with pytest.raises(ExportError, match="the decoder has 9 layers; the C library takes at most 8"):
        model_bytes(latent(decoder=curved(layers=9)))
    with pytest.raises(ExportError, match="no condensed model whose pins move"):
        space = with_moving_pins()
        model_bytes(replace(space, compliance=condensed().compliance))


@pytest.mark.parametrize("make", [latent, condensed, with_moving_pins], ids=["latent", "condensed", "moving pins"])
def test_the_sanitizers_see_no_fault_whatever_the_file_is(
    fuzzer: Path, tmp_path: Path, make: Callable[[], object]
) -> None:
    (tmp_path / "model.ldsim").write_bytes(model_bytes(make()))  # type: ignore[arg-type]
    refused, ran = fuzz.damaged(fuzzer, tmp_path / "model.ldsim", 7, 300)
    assert refused > 100 and ran > 10


@pytest.fixture(scope="module")
def fuzzer(cc: str, tmp_path_factory: pytest.TempPathFactory, sources: Path) -> Path:
    try:
        return fuzz.built(cc, tmp_path_factory.mktemp("fuzz"), sources)
    except subprocess.CalledProcessError as error:
        assert "sanitize" in error.stderr, error.stderr
        pytest.skip("the C compiler has no sanitizers")


def test_the_exported_example_is_built_by_its_makefile_and_pulls(tmp_path: Path, cc: str) -> None:
    if shutil.which("make") is None:
        pytest.skip("make is not installed: it builds the example")
    write_run(tmp_path)
    with Run.open(tmp_path) as run:
        folder, _ = export(run, Choice("c", space="linear"), tmp_path / "made")
    built = subprocess.run(["make", f"CC={cc}", "CFLAGS=-O1"], cwd=folder, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    done = subprocess.run(["./example"], cwd=folder, capture_output=True, text=True)
    lines = done.stdout.splitlines()
    assert len(lines) == 10 and "pulled with 0.0000 N" not in lines[3] and "pulled with 0.0000 N" in lines[-1]
    missing = subprocess.run(["./example", "nothing"], cwd=folder, capture_output=True, text=True)
    assert missing.returncode == 1 and missing.stderr == "the file cannot be read; check its path\n"
