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
    assert settings.experiment.startswith("paper-") or not (CONFIGS / "paper" / f"{name}.yaml").exists()
    assert settings.experiment.endswith("-quick") is quick


@pytest.mark.parametrize("path", sorted((CONFIGS / "paper").glob("*.yaml")), ids=lambda path: path.stem)
def test_the_full_size_is_the_configuration_at_the_paper_s_settings(path: Path) -> None:
    settings = load_settings(path)
    assert settings_of(SCENES[path.stem](False), path.stem) == settings
    assert settings.train.optimiser == "adam" and settings.train.schedule == "fixed" and settings.train.balance == 0
    assert settings.cubature.method == "an" and settings.cubature.tolerance == 0.05
    assert settings.cubature.equal_points and settings.cubature.virtual.points == 0
    minimiser = settings.simulate.minimiser
    assert minimiser is not None and minimiser.method == "lbfgs"
    assert minimiser.every_step and minimiser.wolfe
    assert not (minimiser.current or minimiser.inertia or minimiser.extrapolate)
    assert "test" in settings.snapshot.roles


@pytest.mark.parametrize("path", sorted(CONFIGS.rglob("*.yaml")), ids=lambda path: path.stem)
def test_every_configuration_has_a_motion_that_nothing_looked_at(path: Path) -> None:
    assert "test" in load_settings(path).snapshot.roles


def test_the_x_with_other_columns_is_another_experiment_of_the_same_motions() -> None:
    own, other = scenes.cross(False), scenes.cross(False, 19)
    assert other["experiment"] == "paper-x-19" != own["experiment"]
    assert other["pca"] == {"k": 19}
    assert {key: other[key] for key in ("mesh", "snapshot", "cubature")} == {
        key: own[key] for key in ("mesh", "snapshot", "cubature")
    }
