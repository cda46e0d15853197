"""A little of the campaign of reproduction/faults, from other seeds: nothing but answers and refusals in one line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from ldsim.errors import LdsimError
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.recording import read_recording, write_recording
from ldsim.run import Run
from ldsim.settings import load_settings
from reproduction.faults.alone import alone
from reproduction.faults.bench import EXPERIMENTS, ROOM
from reproduction.faults.campaign import README, fill
from reproduction.faults.mutations import OF_ARTEFACTS, text_spoilt
from reproduction.harness import RESULTS
from tests.cli.experiments import TINY

SEED, ARTEFACTS, TEXTS = 4, 6, 300


def answer(folder: Path) -> str:
    """What becomes of a run: both reduced spaces are made and stepped, or it is refused."""
    try:
        with Run(folder, "playable") as run:
            for name in ("linear", "latent"):
                space = run.space(name)
                if not np.isfinite(space.reduced_basis.fields).all():
                    return "silent"
    except LdsimError as error:
        return "refused" if "\n" not in str(error) else "traceback: two lines"
    return "accepted"


@pytest.mark.parametrize("kind", ["scene", "basis", "model", "cubature"])
@pytest.mark.parametrize("how", OF_ARTEFACTS)
def test_a_spoilt_artefact_is_refused_or_means_what_it_says(
    playable: Path, tmp_path: Path, kind: str, how: str
) -> None:
    spoil, must_be_refused = OF_ARTEFACTS[how]
    rng = np.random.default_rng((SEED, len(kind), len(how)))
    allowed = {"refused"} if must_be_refused else {"refused", "accepted"}
    for number in range(ARTEFACTS):
        folder = tmp_path / str(number)
        shutil.copytree(playable, folder)
        spoil(folder / f"{kind}.h5", rng)
        if (folder / f"{kind}.h5").read_bytes() != (playable / f"{kind}.h5").read_bytes():
            (said,) = alone([lambda folder=folder: answer(folder)], 60.0)
            assert said in allowed, f"number {number}: {said}"


def test_spoilt_configurations_and_recordings_are_refused_or_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(SEED)
    point = rng.normal(size=3)
    write_recording(
        tmp_path / "whole.csv", Motion("a", 20, (Drag(2, point, point + rng.normal(size=(9, 3)), 0.1, 9.0),))
    )
    recording, configuration = (tmp_path / "whole.csv").read_text(), yaml.safe_dump(TINY)
    refused = 0
    for _ in range(TEXTS):
        (tmp_path / "a.csv").write_text(text_spoilt(recording, rng), encoding="utf-8")
        (tmp_path / "a.yaml").write_text(text_spoilt(configuration, rng), encoding="utf-8")
        for read in (lambda: read_recording(tmp_path / "a.csv", "a"), lambda: load_settings(tmp_path / "a.yaml")):
            try:
                read()
            except LdsimError as error:
                refused += 1
                assert len(str(error)) < 10_000
    assert TEXTS / 2 < refused < 2 * TEXTS


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_configurations_of_the_campaign_are_whole(name: str) -> None:
    assert load_settings(ROOM / f"{name}.yaml").experiment == name


def test_the_table_of_the_campaign_is_that_of_its_results() -> None:
    found = json.loads((RESULTS / "faults.json").read_text(encoding="utf-8"))["rows"]
    text = README.read_text(encoding="utf-8")
    assert text == fill(text, found)
    assert "| kills |" in text
