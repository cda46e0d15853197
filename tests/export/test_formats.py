"""The table of formats: each writes what it says, and what does not suit is refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from ldsim.errors import ExportError
from ldsim.export import formats
from ldsim.export.formats import FORMATS, Choice, Extra, Format, export
from ldsim.export.playback import playback
from ldsim.run import Run


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_writes_its_file_or_folder(run: Run, tmp_path: Path, name: str) -> None:
    wanted = FORMATS[name]
    if wanted.extra is not None and wanted.extra.missing:
        pytest.skip(f"{wanted.extra.module} is not installed: {wanted.extra.install}")
    space = "auto" if wanted.model else "latent"
    choice = Choice(name, "push", space, every=4) if wanted.motion else Choice(name, space=space)
    path, what = export(run, choice, tmp_path / f"out{wanted.suffix}")
    assert path.is_file() if wanted.suffix else any(path.iterdir())
    model = "the reduced model" if wanted.model else "the model of the latent space"
    assert what == ("2 frames of push in the latent space" if wanted.motion else model)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_writes_a_motion_or_a_model_or_a_space(name: str) -> None:
    wanted = FORMATS[name]
    assert [wanted.motion, wanted.model, wanted.space].count(None) == 2


def test_without_an_output_the_file_goes_into_the_run(run: Run) -> None:
    path, _ = export(run, Choice("gltf", "push"))
    assert path == run.folder / "export" / "push-latent.glb"


REFUSED = {
    "format": (Choice("vrml"), None, "unknown format 'vrml'; known are vtk, xdmf, gltf"),
    "motion": (Choice("gltf", "jump"), None, "unknown motion 'jump'; known are"),
    "space": (Choice("gltf", space="outer"), None, "unknown space 'outer'; known are full, linear, latent"),
    "motion of the full space": (Choice("ply", "jump", "full"), None, "unknown motion 'jump'; known are pull_1, push"),
    "a basis of the full space": (Choice("gltf", space="full"), None, "use --space linear or latent"),
    "a model of the full space": (Choice("c", space="full"), "a", "c writes a reduced space, got 'full'"),
    "too few frames": (Choice("gltf", every=1000), None, "leaves none of the 14 frames"),
    "suffix": (Choice("gltf"), "a.mp4", "has the suffix '.mp4'; expected '.glb'"),
    "folder for a file": (Choice("gltf"), "taken.glb", "is a folder"),
    "folder that exists": (Choice("ply"), "taken.glb", "exists already"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_suit_is_refused_and_nothing_is_written(run: Run, tmp_path: Path, case: str) -> None:
    choice, output, words = REFUSED[case]
    (tmp_path / "taken.glb").mkdir()
    with pytest.raises(ExportError) as refusal:
        export(run, choice, tmp_path / (output or "a.glb"))
    assert words in str(refusal.value)
    assert [entry.name for entry in tmp_path.rglob("*")] == ["taken.glb"]


def test_a_missing_package_is_named_with_what_installs_it(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    missing = Format("nothing", ".no", motion=FORMATS["gltf"].motion, extra=Extra("not_there", "pip install 'it'"))
    monkeypatch.setitem(formats.FORMATS, "no", missing)
    with pytest.raises(ExportError, match="needs the package not_there, which is not installed; run pip install 'it'"):
        export(run, Choice("no"), tmp_path / "a.no")


def test_a_run_that_diverged_is_exported_up_to_there(tmp_path: Path) -> None:
    from tests.report.small_run import LOST_FROM, write_run

    write_run(tmp_path, lost=("latent", "push"))
    with Run.open(tmp_path) as run:
        assert playback(run, "push", "latent").frames == LOST_FROM
        path, what = export(run, Choice("gltf", "push"))
    assert path.is_file()
    assert what == f"{LOST_FROM} frames of push in the latent space, 6 left out because the run diverged"
