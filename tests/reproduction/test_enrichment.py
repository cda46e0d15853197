"""Configurations with and without own runs, of a solid that `ldsim new` has looked at."""

from __future__ import annotations

from pathlib import Path

import pytest

from ldsim.settings import load_settings
from ldsim.settings.new import NewOptions, new
from reproduction.bench.enrichment import EXPLORED, JUDGES, POSES, configured


@pytest.mark.parametrize("own", [True, False])
def test_it_has_so_many_pulls_and_as_many_poses_with_own_runs_as_without(tmp_path: Path, own: bool) -> None:
    config = tmp_path / "beam.yaml"
    new(None, NewOptions(shape="beam", resolution=1, output=config), tmp_path)
    found = configured(load_settings(config), 7, own, seed=2, r=5)
    learned, judging = (motion.pulls for motion in found.snapshot.motions)
    assert learned is not None and judging is not None and (learned.count, judging.count) == (7, JUDGES)
    assert found.snapshot.roles == ("train", "validation")
    condensed = found.train.condensed
    poses, explored = condensed.relaxed(300)
    assert (found.train.r, found.train.seed, condensed.rounds) == (5, 2, 2 if own else 0)
    assert poses + condensed.rounds * explored == POSES and (not own or explored == EXPLORED)
