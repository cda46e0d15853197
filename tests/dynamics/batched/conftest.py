"""Both ways to step a batch."""

from __future__ import annotations

import pytest

from ldsim.dynamics.batched import stepper as batched_stepper


@pytest.fixture(params=["compiled", "on tensors"])
def steps(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A processor takes the compiled steps; those on tensors, a graphics card's, have to be the same."""
    if request.param == "on tensors":
        monkeypatch.setattr(batched_stepper, "is_compiled", lambda device, dtype: False)
