"""The experiments' configurations: valid, and in full size those of configs/."""

from __future__ import annotations

from pathlib import Path

import pytest

from ldsim.settings import load_settings, settings_of
from reproduction.harness import CONFIGS
from reproduction.paper import scenes

SCENES = {
    "x": scenes.cross,
    "beam": scenes.bar,
    "coarse-beam": scenes.coarse_bar,
    "dragon": scenes.dragon,
    "elephant": scenes.elephant,
    "armadillo": scenes.armadillo,
    "catapult": scenes.catapult,
}


@pytest.mark.parametrize("quick", [True, False], ids=["quick", "full"])
@pytest.mark.parametrize("name", SCENES)
def test_a_configuration_is_valid(name: str, quick: bool) -> None:
    settings = settings_of(SCENES[name](quick), name)
    assert settings.experiment == (f"paper-{settings.experiment.removeprefix('paper-')}" if quick else name)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_full_size_is_the_experiment_of_that_name(path: Path) -> None:
    if path.stem in SCENES:
        assert settings_of(SCENES[path.stem](False), path.stem) == load_settings(path)
