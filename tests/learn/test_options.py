"""Options of training: which of them say nothing to the kind of space that is trained."""

from __future__ import annotations

from typing import Any

import pytest

from ldsim.learn.options import TrainOptions

TOLD: dict[str, tuple[dict[str, Any], str]] = {
    "nothing given": ({}, ""),
    "a condensed space": ({"kind": "condensed", "r": 8, "hidden": (8,), "seed": 3, "condensed": {"rounds": 1}}, ""),
    "a default": ({"kind": "condensed", "epochs": TrainOptions().epochs}, ""),
    "epochs": (
        {"kind": "condensed", "epochs": 20},
        "note: train.epochs has no effect: train.kind is condensed",
    ),
    "several": (
        {"kind": "condensed", "batch": 20, "epochs": 20, "equilibrium": {"weight": 1.0}},
        "note: train.equilibrium, train.epochs, train.batch have no effect: train.kind is condensed",
    ),
    "an autoencoder": ({"epochs": 20, "r": 8}, ""),
    "poses to relax": ({"condensed": {"poses": 20}}, "note: train.condensed has no effect: train.kind is autoencoder"),
}


@pytest.mark.parametrize(("given", "told"), TOLD.values(), ids=TOLD)
def test_what_was_given_to_no_effect_is_told(given: dict[str, Any], told: str) -> None:
    assert TrainOptions(**given).without_effect() == told
