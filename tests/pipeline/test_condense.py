"""What has no condensed space is refused before anything is relaxed, and own pulls have places of their own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ldsim.errors import SettingsError
from ldsim.mesh.shapes import beam
from ldsim.pipeline import condense
from tests.helpers import scene


def run_of(poisson_ratio: float = 0.4, k: int = 100) -> Any:
    """What is looked at of a run, with as many columns as one likes."""
    body = scene(beam(resolution=1), "stable_neo_hookean", poisson_ratio=poisson_ratio)
    return SimpleNamespace(
        scene=body,
        basis=SimpleNamespace(metric=body.mass, k=k),
        header=lambda kind: SimpleNamespace(notes={}),
        lifting=SimpleNamespace(count=0),
    )


def test_a_material_that_grows_thicker_when_stretched_is_refused() -> None:
    condense._refuse(run_of(), 4)
    with pytest.raises(SettingsError, match="negative Poisson's ratio"):
        condense._refuse(run_of(poisson_ratio=-0.1), 4)


def test_as_many_coordinates_as_leave_nothing_beside_them_are_refused() -> None:
    run = run_of()
    unknowns = 3 * len(run.scene.free)
    condense._refuse(run, unknowns // 2 - 1)
    with pytest.raises(SettingsError, match=f"the solid has {unknowns} unknowns, which leaves nothing beside"):
        condense._refuse(run, unknowns // 2 + 1)


def test_own_pulls_have_places_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """`ldsim new` gives its motions the seeds 1 to 4; pulls of the same seed are at the same places."""
    seeds: list[int] = []

    def stopped(name: str, scene: object, like: object, count: int, seed: int) -> None:
        seeds.append(seed)
        raise KeyboardInterrupt

    monkeypatch.setattr(condense, "covering_pulls", stopped)
    for seed in range(3):
        run = SimpleNamespace(scene=None, snapshots=SimpleNamespace(with_role=lambda role: ()))
        options = SimpleNamespace(seed=seed)
        for number in range(5):
            with pytest.raises(KeyboardInterrupt):
                condense._Work._own_frames(SimpleNamespace(run=run, options=options, explored=10), None, number)  # type: ignore[arg-type]
    assert len(set(seeds)) == 15 and np.min(seeds) > 1000
