"""An export that does not suit the run, or a run that is not whole, costs one line and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.experiments import Experiment, invoked, refused
from tests.cli.spoiled import ARTEFACTS

EXPORTS: dict[str, tuple[list[str], str]] = {
    "an unknown format": (["--format", "vrml"], "unknown format 'vrml'; known are vtk, xdmf, gltf"),
    "an unknown motion": (["--format", "gltf", "--motion", "c"], "unknown motion 'c'; known are a, b"),
    "an unknown space": (["--format", "gltf", "--space", "outer"], "unknown space 'outer'; known are full, linear"),
    "a basis of the full space": (["--format", "usd", "--space", "full"], "use --space linear or latent"),
    "too few frames": (["--format", "ply", "--every", "99"], "leaves none of the 40 frames"),
    "another suffix": (["--format", "gltf", "--output", "a.mp4"], "expected '.glb'"),
    "a look of what is no picture": (["--format", "gltf", "--fps", "20"], "--fps, --size and --view are for webp"),
    "a motion of a model": (
        ["--format", "npz", "--motion", "a"],
        "npz plays no motion; --motion and --every are for vtk",
    ),
    "a thinned library": (["--format", "c", "--every", "2"], "c plays no motion; --motion and --every are for vtk"),
    "a space of all": (["--playground", "--space", "linear"], "holds every reduced space; --space is for vtk"),
    "a folder that exists": (["--format", "ply", "--output", "."], "exists already"),
}


@pytest.mark.parametrize("case", EXPORTS)
def test_an_export_that_does_not_suit(experiment: Experiment, case: str) -> None:
    options, words = EXPORTS[case]
    if "usd" in options:
        pytest.importorskip("pxr", reason="usd-core is not installed: pip install 'ldsim[usd]'")
    before = experiment.finished()
    message = refused(invoked("export", str(experiment.run), *options))
    assert words in message
    assert experiment.finished() == before


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--fps", "nan", "is not a finite number"),
        ("--size", "1280", "is no size"),
        ("--size", "20x20", "is no size"),
        ("--view", "30", "such as 30,15, or front"),
    ],
)
def test_a_look_that_is_none(option: str, value: str, words: str) -> None:
    result = invoked("export", "nowhere", "--format", "webp", option, value)
    assert result.exit_code == 2 and words in result.output


BAD = [(f"{kind}.h5", case) for kind in ("scene", "basis", "model", "cubature", "snapshots") for case in ARTEFACTS]


@pytest.mark.parametrize(("file", "case"), [bad for bad in BAD if bad != ("snapshots.h5", "missing")])
def test_a_bad_artefact_of_a_run_to_export(experiment: Experiment, file: str, case: str) -> None:
    spoil, words = ARTEFACTS[case]
    spoil(experiment.run / file)
    before = experiment.finished()
    message = refused(invoked("export", str(experiment.run), "--playground"))
    assert file in message
    assert any(word in message for word in words), message
    assert experiment.finished() == before


def test_a_model_is_exported_without_the_motions_that_it_was_made_from(experiment: Experiment) -> None:
    (experiment.run / "snapshots.h5").unlink()
    for options in (["--playground"], ["--format", "npz"]):
        result = invoked("export", str(experiment.run), *options)
        assert result.exit_code == 0, result.output


def test_an_export_of_no_run(tmp_path: Path) -> None:
    message = refused(invoked("export", str(tmp_path / "nothing"), "--format", "gltf"))
    assert "nothing is not the folder of a run; give one such as runs/demo" in message
